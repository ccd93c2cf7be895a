//! The wait loop of every service: one thread, one epoll, woken by inputs, timers, the clock and the supervisor's line.
//!
//! Beats are published from this very loop, so a service that is stuck in its work is silent.

use messages::{ClockAck, ClockStep, Health, MAX_MEMBERS, MAX_PORTS, Member, QUANTUM_NS, ServiceState};

use crate::io::{Io, TOKEN_CONTROL, TOKEN_ORPHANED, TOKEN_OWN};
use crate::line::{FromChild, Received, ToChild};
use crate::master::Master;
use crate::port::{Publisher, Subscriber};
use crate::service::Service;
use crate::usage::Usage;
use crate::{ClockKind, TransportError, monotonic_ns};

/// Period of the beats of a process that is not a service, milliseconds.
const BEAT_MS: u32 = 100;
/// Wall ticks, for who asked for them.
const WALL_TICK_NS: u64 = 20_000_000;
/// What is due within this long is done by a loop that is awake anyway.
const EARLY_NS: u64 = 4_000_000;
/// How long a service that has left waits for the supervisor to take its last figures.
const LEAVE_LIMIT_NS: u64 = 2_000_000_000;

/// How the loop goes on after the lines were served.
#[derive(PartialEq)]
enum Flow {
    On,
    End,
}

pub(crate) struct WaitLoop {
    health: Publisher<Health>,
    usage: Usage,
    beat_ns: u64,
    next_beat_ns: u64,
    next_wall_tick_ns: u64,
    state: ServiceState,
    leave_by_ns: Option<u64>,
    tokens: Vec<u64>,
    steps: Option<Subscriber<ClockStep>>,
    step_out: Option<Publisher<ClockStep>>,
    acks: Option<Subscriber<ClockAck>>,
    ack_out: Option<Publisher<ClockAck>>,
    /// The step taken but not yet acknowledged.
    unacknowledged: bool,
    roster_sent: u64,
    told_time_over: bool,
}

impl WaitLoop {
    pub fn open<S: Service>(io: &mut Io, service: &S) -> Result<Self, TransportError> {
        let stepped = io.domain.clock.is_stepped();
        let master = stepped && service.is_clock_master();
        let period_ms = io.identity().service.spec().map_or(BEAT_MS, |spec| spec.beat_period_ms);
        Ok(Self {
            health: io.publisher()?,
            usage: Usage::default(),
            beat_ns: u64::from(period_ms) * 1_000_000,
            next_beat_ns: 0,
            next_wall_tick_ns: 0,
            state: ServiceState::Ready,
            leave_by_ns: None,
            tokens: Vec::with_capacity(32),
            steps: if stepped && !master { Some(io.subscriber()?) } else { None },
            step_out: if master { Some(io.publisher()?) } else { None },
            acks: if master { Some(io.subscriber()?) } else { None },
            ack_out: if stepped && !master { Some(io.publisher()?) } else { None },
            unacknowledged: false,
            roster_sent: 0,
            told_time_over: false,
        })
    }

    pub fn run_real<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        loop {
            let now = io.now_ns();
            let late = io.faults().next_late_ns();
            let due = [service.next_timer_ns(), Some(self.next_beat_ns), late].into_iter().flatten().min();
            let mut timeout = due.map(|due| due.saturating_sub(now));
            if service.wants_wall_ticks() {
                timeout = earlier(timeout, self.next_wall_tick_ns.saturating_sub(monotonic_ns()));
            }
            io.wait(timeout, &mut self.tokens)?;
            io.drain_listeners();
            if self.serve_lines(io, service)? == Flow::End {
                return Ok(());
            }
            io.faults().drag(io.now_ns());
            service.on_wake(io)?;
            io.faults().send_late(io.now_ns())?;
            self.beat(io, service)?;
            self.tell_time_over(io, service)?;
            if service.is_done() {
                return Ok(());
            }
        }
    }

    fn tell_time_over<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        if service.time_is_over() && !self.told_time_over {
            self.told_time_over = true;
            service.on_time_over(io)?;
        }
        Ok(())
    }

    pub fn run_stepped<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        if service.is_clock_master() {
            return self.run_master(io, service);
        }
        loop {
            let timeout = if service.wants_wall_ticks() || self.leave_by_ns.is_some() {
                Some(self.next_wall_tick_ns.saturating_sub(monotonic_ns()).min(WALL_TICK_NS))
            } else {
                None
            };
            io.wait(timeout, &mut self.tokens)?;
            io.drain_listeners();
            if self.serve_lines(io, service)? == Flow::End || service.is_done() {
                return Ok(());
            }
            if self.take_steps(io, service)? == Flow::End {
                return Ok(());
            }
            self.acknowledge(io, service)?;
        }
    }

    /// What lies in the lines by now: what happened before a step was given is known to everybody in it.
    fn serve_waiting_lines<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        io.wait(Some(0), &mut self.tokens)?;
        self.serve_lines(io, service)
    }

    fn take_steps<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        let me = Member { service: io.identity().service, incarnation: io.identity().incarnation };
        while let Some(step) = self.steps.as_mut().map_or(Ok(None), Subscriber::receive)? {
            if !step.members().contains(&me) || step.header.step <= io.domain.clock.step() {
                continue;
            }
            if self.serve_waiting_lines(io, service)? == Flow::End {
                return Ok(Flow::End);
            }
            io.domain.clock.enter(step.header.step, step.header.stamp_ns);
            io.faults().drag(io.now_ns());
            service.on_wake(io)?;
            io.faults().send_late(io.now_ns())?;
            self.beat(io, service)?;
            self.unacknowledged = true;
        }
        Ok(Flow::On)
    }

    /// Acknowledges the step, or tells a new roster while the step is held.
    fn acknowledge<S: Service>(&mut self, io: &Io, service: &S) -> Result<(), TransportError> {
        let may = self.unacknowledged && service.may_acknowledge();
        let roster = service.roster();
        let news = roster.is_some_and(|(version, _)| version > self.roster_sent);
        let Some(out) = self.ack_out.as_mut().filter(|_| may || news) else { return Ok(()) };
        let identity = io.identity();
        let mut ack = ClockAck {
            member: Member { service: identity.service, incarnation: identity.incarnation },
            ..ClockAck::default()
        };
        if let Some((version, members)) = roster {
            ack.roster_version = version;
            ack.roster_count = members.len().min(MAX_MEMBERS) as u32;
            for (slot, member) in ack.roster.iter_mut().zip(members) {
                *slot = *member;
            }
            self.roster_sent = version;
        }
        // A roster alone acknowledges nothing: its stamp is 0. Steps are numbered from 1, at 10 ms and later.
        out.publish(if may { io.now_ns() } else { 0 }, ack)?;
        self.unacknowledged &= !may;
        Ok(())
    }

    /// Gives out steps to the members of the newest roster, one when all have done the one before.
    fn run_master<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        let ClockKind::Stepped { speed } = io.domain.clock.kind() else { return Ok(()) };
        let pace_ns = if speed > 0.0 { (QUANTUM_NS as f64 / speed) as u64 } else { 0 };
        let mut master = Master::default();
        loop {
            let ready = master.may_step(pace_ns);
            let idle = master.is_waiting() || self.told_time_over;
            let timeout = if idle { None } else { Some(ready.saturating_sub(monotonic_ns())) };
            if timeout != Some(0) {
                io.wait(timeout.or(Some(WALL_TICK_NS * 5)), &mut self.tokens)?;
                io.drain_listeners();
            } else {
                self.tokens.clear();
                self.tokens.push(TOKEN_CONTROL);
            }
            if self.serve_lines(io, service)? == Flow::End || service.is_done() {
                return Ok(());
            }
            while let Some(ack) = self.acks.as_mut().map_or(Ok(None), Subscriber::receive)? {
                master.take(&ack);
            }
            if master.is_waiting() || monotonic_ns() < master.may_step(pace_ns) {
                continue;
            }
            if service.time_is_over() {
                self.tell_time_over(io, service)?;
            } else if self.serve_waiting_lines(io, service)? == Flow::End {
                return Ok(());
            } else {
                self.give_step(io, service, &mut master, pace_ns)?;
            }
        }
    }

    fn give_step<S: Service>(
        &mut self,
        io: &mut Io,
        service: &mut S,
        master: &mut Master,
        pace_ns: u64,
    ) -> Result<(), TransportError> {
        let step = io.domain.clock.step() + 1;
        io.domain.clock.enter(step, step * QUANTUM_NS);
        master.begin(step, pace_ns);
        let mut message = ClockStep { member_count: master.roster.len() as u32, ..ClockStep::default() };
        for (slot, member) in message.members.iter_mut().zip(&master.roster) {
            *slot = *member;
        }
        if let Some(out) = self.step_out.as_mut() {
            out.publish(step * QUANTUM_NS, message)?;
        }
        io.faults().drag(io.now_ns());
        service.on_wake(io)?;
        io.faults().send_late(io.now_ns())?;
        self.beat(io, service)
    }

    /// Serves the control line and the service's own descriptors, and the wall tick.
    fn serve_lines<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        let tokens = std::mem::take(&mut self.tokens);
        for token in &tokens {
            if *token >= TOKEN_OWN {
                service.on_fd(io, token - TOKEN_OWN)?;
            } else if *token == TOKEN_ORPHANED {
                io.let_go_of_supervisor();
                if service.on_supervisor_lost(io) {
                    return Ok(Flow::End);
                }
            } else if *token == TOKEN_CONTROL && self.serve_control(io, service)? == Flow::End {
                return Ok(Flow::End);
            }
        }
        self.tokens = tokens;
        let now = monotonic_ns();
        if self.leave_by_ns.is_some_and(|by| now > by) {
            return Ok(Flow::End);
        }
        if now + EARLY_NS >= self.next_wall_tick_ns {
            self.next_wall_tick_ns = now + WALL_TICK_NS;
            if service.wants_wall_ticks() {
                service.on_wall_tick(io)?;
            }
        }
        Ok(Flow::On)
    }

    fn serve_control<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        loop {
            match io.receive_control() {
                Received::Nothing => return Ok(Flow::On),
                Received::Closed => {
                    return Ok(if service.on_supervisor_lost(io) { Flow::End } else { Flow::On });
                }
                Received::Message(ToChild::Leave, _) => {
                    service.on_leave(io)?;
                    self.state = ServiceState::Leaving;
                    self.next_beat_ns = 0;
                    self.beat(io, service)?;
                    self.leave_by_ns = Some(monotonic_ns() + LEAVE_LIMIT_NS);
                    io.tell(&FromChild::Left);
                }
                Received::Message(ToChild::Exit, _) => return Ok(Flow::End),
                Received::Message(ToChild::Inject { injection }, _) => {
                    io.inject(&injection);
                }
                Received::Message(message, fd) => service.on_control(io, message, fd)?,
            }
        }
    }

    /// Publishes the beat when it is due.
    fn beat<S: Service>(&mut self, io: &Io, service: &S) -> Result<(), TransportError> {
        let now = io.now_ns();
        // A loop that is awake beats a little early rather than wake up again for it.
        if now + EARLY_NS < self.next_beat_ns {
            return Ok(());
        }
        self.next_beat_ns = now + self.beat_ns;
        io.faults().leak(now);
        let identity = io.identity();
        self.usage.refresh();
        let mut health = Health {
            service: identity.service,
            state: self.state,
            pid: std::process::id(),
            open_files: self.usage.open_files,
            resident_bytes: self.usage.resident_bytes,
            private_bytes: self.usage.private_bytes,
            ..Health::default()
        };
        let counters = io.counters();
        // The supervisor reads of everybody, and tells of no more ports than a beat has room for.
        health.port_count = counters.len().min(MAX_PORTS) as u32;
        for (slot, port) in health.ports.iter_mut().zip(counters.iter()) {
            *slot = *port;
        }
        drop(counters);
        service.fill_health(&mut health);
        self.health.publish(now, health).map(|_| ())
    }
}

fn earlier(a: Option<u64>, b: u64) -> Option<u64> {
    Some(a.map_or(b, |a| a.min(b)))
}
