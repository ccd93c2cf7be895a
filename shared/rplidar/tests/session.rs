//! The driver's side of the conversation against the emulated lidar's, over a line of a simulated speed.

use guidedog_rplidar::{
    Beams, Do, Emulated, Fan, Format, Health, Model, SILENCE_NS, Sample, Session, SessionError, Turns, Wanted,
};

const STEP_NS: u64 = 1_000_000;
const ROUND: Beams =
    Beams { count: 360, angle_min_rad: -std::f64::consts::PI, angle_increment_rad: std::f64::consts::TAU / 360.0 };
const S: u64 = 1_000_000_000;

/// A lidar, its line and who talks to it.
struct Rig {
    now_ns: u64,
    lidar: Emulated,
    session: Session,
    samples: Vec<Sample>,
    unplugged: bool,
}

impl Rig {
    fn new(model: Model, mode: Option<&str>) -> Self {
        let wanted = Wanted { baud: model.baud(), mode: mode.map(str::to_owned), motor_rpm: 600, searches: false };
        let session = Session::new(wanted, 0);
        Self { now_ns: 0, lidar: Emulated::new(model), session, samples: Vec::new(), unplugged: false }
    }

    /// A round room, and nothing in a quarter of it to the left.
    fn run(&mut self, for_ns: u64) {
        let until_ns = self.now_ns + for_ns;
        while self.now_ns < until_ns && self.session.error().is_none() {
            self.now_ns += STEP_NS;
            self.session.tick(self.now_ns);
            let mut sent = Vec::new();
            while let Some(to_do) = self.session.next_to_do() {
                if let Do::Write(bytes) = to_do {
                    self.lidar.received(self.now_ns, &bytes, &mut sent);
                }
            }
            self.lidar.advance(self.now_ns, |angle, _| ((angle + 360.0) % 360.0 < 270.0).then_some(2.5), &mut sent);
            if !self.unplugged {
                self.session.received(self.now_ns, &sent, &mut self.samples);
            }
        }
    }
}

#[test]
fn every_lidar_scans_a_second_after_it_was_met() {
    for model in Model::ALL {
        let mut rig = Rig::new(model, None);
        rig.run(S);
        let found = rig.session.running().unwrap_or_else(|| panic!("{model:?}: {:?}", rig.session));
        assert!(found.sample_ns > 10_000, "{model:?}: {found:?}");
        rig.samples.clear();
        rig.run(S);
        let (mut turns, mut fan) = (Turns::default(), Fan::new(ROUND, 0.02));
        let mut seen = Vec::new();
        for sample in &rig.samples {
            if let Some(turn) = turns.push(sample) {
                turn.iter().for_each(|sample| fan.enter(sample));
                let ranges_m = fan.ranges_m();
                let known: Vec<usize> = (0..360).filter(|beam| !ranges_m[*beam].is_nan()).collect();
                assert!(ranges_m.iter().all(|range_m| range_m.is_nan() || (*range_m - 2.5).abs() < 0.01));
                let stamps_ns = (turn[0].stamp_ns, turn[turn.len() - 1].stamp_ns);
                seen.push((known.first().copied(), known.last().copied(), turn.len(), stamps_ns));
            }
        }
        assert!(seen.len() >= 6, "{model:?}: {} turns in a second", seen.len());
        for (first, last, samples, (from_ns, to_ns)) in seen {
            // Counter-clockwise from straight back: right side, ahead; nothing from ahead to the left.
            assert!(first.is_some_and(|beam| beam < 3), "{model:?}: {first:?}");
            assert!(last.is_some_and(|beam| beam <= 181 || beam >= 268), "{model:?}: {last:?}");
            assert!(samples > 190 && to_ns - from_ns < 130_000_000, "{model:?}: {samples} in {}", to_ns - from_ns);
        }
        let age_ns = rig.now_ns - rig.samples.last().expect("samples").stamp_ns;
        assert!(age_ns < 60_000_000, "{model:?}: the newest sample is {age_ns} ns old");
    }
}

#[test]
fn a_mode_is_chosen_by_its_name() {
    for (name, format) in [("standard", Format::Standard), ("Express", Format::Express), ("Boost", Format::Ultra)] {
        let mut rig = Rig::new(Model::A1, Some(name));
        rig.run(2 * S);
        assert_eq!(rig.session.running().map(|found| found.format), Some(format), "{name}");
    }
    let mut rig = Rig::new(Model::S2, Some("Turbo"));
    rig.run(2 * S);
    let text = rig.session.error().expect("no such mode").to_string();
    assert_eq!(text, "the lidar has no mode \"Turbo\", only Standard, DenseBoost");
}

#[test]
fn a_line_that_goes_quiet_is_taken_up_again() {
    let mut rig = Rig::new(Model::S2, None);
    rig.run(S);
    rig.unplugged = true;
    rig.run(SILENCE_NS + 10 * STEP_NS);
    assert!(rig.session.running().is_none() && rig.session.error().is_none());
    rig.unplugged = false;
    rig.run(S);
    assert!(rig.session.running().is_some());
}

#[test]
fn why_there_is_no_scan_is_told() {
    let mut silent = Rig::new(Model::A1, None);
    silent.unplugged = true;
    silent.run(20 * S);
    assert_eq!(silent.session.error(), Some(&SessionError::Silent { baud: 115_200 }));

    let mut garbled = Session::new(Wanted { baud: 256_000, mode: None, motor_rpm: 600, searches: false }, 0);
    for step in 0..20_000 {
        garbled.tick(step * STEP_NS);
        garbled.received(step * STEP_NS, &[0xf8, 0x00, 0x80, 0xa5], &mut Vec::new());
    }
    assert_eq!(garbled.error(), Some(&SessionError::Garbled { baud: 256_000 }));

    let mut ill = Rig::new(Model::A2, None);
    ill.lidar.set_health(Health { status: Health::ERROR, code: 0x8001 });
    ill.run(4 * S);
    assert!(ill.session.running().is_some(), "a reset has healed it");
    // Mended by nothing: the next reset does not reach it.
    let mut broken = Rig::new(Model::A2, None);
    for _ in 0..6000 {
        broken.lidar.set_health(Health { status: Health::ERROR, code: 0x8001 });
        broken.run(STEP_NS);
    }
    assert_eq!(broken.session.error(), Some(&SessionError::Broken { code: 0x8001 }));
}
