//! Policies that no robot should walk by: started by the supervisor through a link whose name says what is wrong.

use std::process::ExitCode;
use std::time::Duration;

use guidance::ActionTable;
use guidedog_policy::PolicyService;
use messages::{Health, MAX_ACTIONS, Mode, NS_PER_S, ServiceId};
use policies::{Engine, EngineError, Probabilities, Situation};
use transport::{Io, Service, Subscriber, TransportError};

/// What is wrong with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    Nan,
    Slow,
    OtherTable,
    CrashInShadow,
    HangOnActivation,
    CrashOnProbation,
}

impl Fault {
    fn of_own_name() -> Option<Self> {
        let own = std::env::args().next()?;
        Some(match std::path::Path::new(&own).file_name()?.to_str()? {
            "nan" => Self::Nan,
            "slow" => Self::Slow,
            "other-table" => Self::OtherTable,
            "crash-in-shadow" => Self::CrashInShadow,
            "hang-on-activation" => Self::HangOnActivation,
            "crash-on-probation" => Self::CrashOnProbation,
            _ => return None,
        })
    }
}

/// Walks straight on, but for its fault.
struct Straight {
    fault: Fault,
    decisions: u32,
}

impl Engine for Straight {
    fn decide(&mut self, _situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        self.decisions += 1;
        let mut probabilities = [0.0; MAX_ACTIONS];
        probabilities[ActionTable::STOP + 1] = 1.0;
        match self.fault {
            Fault::Nan => probabilities[ActionTable::STOP] = f32::NAN,
            // It is what is measured here.
            Fault::Slow => std::thread::sleep(Duration::from_millis(80)),
            Fault::CrashInShadow if self.decisions == 2 => std::process::abort(),
            _ => {}
        }
        Ok(probabilities)
    }
}

struct Faulty {
    policy: PolicyService,
    modes: Subscriber<Mode>,
    fault: Fault,
    named_ns: Option<u64>,
}

impl Faulty {
    fn open(io: &mut Io) -> Result<Self, TransportError> {
        let fault = Fault::of_own_name().ok_or_else(|| TransportError::service("no fault of that name"))?;
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let table = match fault {
            Fault::OtherTable => ActionTable::ten(),
            _ => settings.policy.actions.table(),
        };
        let engine = Box::new(Straight { fault, decisions: 0 });
        let policy = PolicyService::with_engine(io, &settings, &table, engine)?;
        Ok(Self { policy, modes: io.quiet_subscriber()?, fault, named_ns: None })
    }
}

impl Service for Faulty {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        while let Some(mode) = self.modes.take()? {
            if mode.active_policy == io.identity().incarnation {
                self.named_ns.get_or_insert(io.now_ns());
            }
        }
        let named = self.named_ns.is_some();
        let on_probation = self.named_ns.is_some_and(|named| io.now_ns() > named + NS_PER_S);
        match self.fault {
            Fault::HangOnActivation if named => loop {
                std::thread::park();
            },
            Fault::CrashOnProbation if on_probation => std::process::abort(),
            _ => self.policy.on_wake(io),
        }
    }

    fn next_timer_ns(&self) -> Option<u64> {
        self.policy.next_timer_ns()
    }

    fn fill_health(&self, health: &mut Health) {
        self.policy.fill_health(health);
    }
}

fn main() -> ExitCode {
    transport::service_main(ServiceId::Policy, Faulty::open)
}
