//! In the steady state a scan is taken in and judged without an allocation: none can fail, none takes a lock.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use guidedog_guidance::se2::Point;
use guidedog_guidance::{
    ActionTable, Beams, DelayedHarness, DepthView, EdgeDistance, Evidence, Footing, HandlerEstimate, HandlerLimits,
    Memory, MemoryConfig, Reach, Se2, Shield, ShieldConfig, StepMax, Tilt,
};
use messages::{Attitude, DepthHeader, Pose3, ScanHeader};

/// Counts what it hands out.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn taking_in_and_judging_a_scan_allocates_nothing_once_warm() {
    let config = ShieldConfig {
        robot_radius_m: 0.3,
        margin_m: 0.0,
        unknown_gap_m: 0.1,
        escape: true,
        unseen_limit_m2: Some(10.0),
        back_from_edges_m: None,
        reach: Reach::default(),
        edges: EdgeDistance::default(),
    };
    let limits = HandlerLimits { radius_m: 0.25, seen_radius_m: 0.25, speed_max_mps: 0.5, not_seen_ns: 1_000_000_000 };
    let mut handler = HandlerEstimate::new(DelayedHarness::default(), limits);
    let (mut shield, mut stamped, mut beams) = (Shield::new(config), Beams::default(), Beams::default());
    let mut memory = Memory::new(MemoryConfig {
        kept_ns: 500_000_000,
        kept_off_plane_ns: 500_000_000,
        free_ns: 500_000_000,
        drift: 0.03,
        footing: Some(Footing {
            radius_m: 0.3,
            nose_m: 0.0,
            handler_m: 0.25,
            overrun_m: 0.2,
            overrun_rad: 0.1,
            step_max: StepMax { down_m: 0.12, up_m: 0.06 },
        }),
    });
    let (table, mut judgements) = (ActionTable::ten(), Vec::new());
    let header = ScanHeader {
        angle_min_rad: -std::f64::consts::PI,
        angle_increment_rad: std::f64::consts::TAU / 1440.0,
        range_min_m: 0.15,
        range_max_m: 12.0,
        sigma_m: 0.01,
        ..ScanHeader::default()
    };
    // Everything that can happen to a beam: far, near, pressing on the robot, on the handler, unknown.
    let scan = |n: usize| -> Vec<f32> {
        let reading = |i: usize| match (i * 7 + n) % 23 {
            0 => f32::NAN,
            1 => 0.28,
            2 => 0.5,
            _ => 0.7 + (i % 50) as f32 * 0.05,
        };
        (0..1440).map(reading).collect()
    };
    let scans: Vec<Vec<f32>> = (0..20).map(scan).collect();
    // A drop before the robot, a low step, and now and then none.
    let ends = |n: usize| if n % 8 < 6 { frame(0.8, 0.5) } else { frame(9.0, 0.5) };
    let frames: Vec<_> = (0..20).map(|n| if n % 4 == 1 { frame(1.1, 0.08) } else { ends(n) }).collect();
    let level = Attitude { stamp_ns: 1, height_m: 0.3, standing_m: 0.3, ..Attitude::default() };
    let tilt = Tilt::of(&level).expect("known");
    let mut view = DepthView::with_steps(StepMax { down_m: 0.12, up_m: 0.06 });
    let mut before = 0;
    for (n, ranges) in scans.iter().enumerate() {
        if n == 12 {
            before = ALLOCATIONS.load(Ordering::Relaxed);
        }
        stamped.fill(&header, ranges).expect("usable");
        stamped.seen_from(&Se2::rotation(0.01 * n as f64), &mut beams);
        handler.predict(&Se2::identity(), 0.1);
        let _ = handler.correct(&beams, n as u64);
        let (depth_header, pixels_mm) = &frames[n];
        view.fill_tilted(depth_header, pixels_mm, Some(&tilt)).expect("usable");
        let odom_from_robot = Se2::rotation(0.01 * n as f64);
        memory.update(n as u64 * 100_000_000, &odom_from_robot, &beams, Some(&view), &handler.body(0.01));
        let evidence = Evidence { memory: Some(&memory), ..Evidence::scan(&beams) };
        shield.judge_actions(&table, evidence, &handler, &mut judgements);
    }
    assert_eq!(judgements.len(), 10);
    assert!(judgements.iter().any(|judgement| !judgement.safe), "the scans are not all free");
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0);
    assert!(!memory.edges().is_empty(), "the drop is remembered");
    assert!(!memory.steps().is_empty(), "and the step");
    assert!(memory.unseen_floor(Point::origin(), 2.0).next().is_some(), "floor is remembered");
}

/// What a level camera sees of a floor that ends so far before it, metres, where the ground lies so much lower, metres.
fn frame(edge_m: f64, drop_m: f64) -> (DepthHeader, Vec<u16>) {
    const HEIGHT_M: f64 = 0.4;
    let header = DepthHeader {
        width: 64,
        height: 48,
        fx_px: 32.0,
        fy_px: 32.0,
        cx_px: 31.5,
        cy_px: 23.5,
        robot_from_camera: Pose3 { x_m: 0.25, z_m: HEIGHT_M, ..Pose3::default() },
        ..DepthHeader::default()
    };
    let depth_mm = |row: u32| {
        let down = (f64::from(row) - header.cy_px) / header.fy_px;
        let to_m = |drop_m: f64| (HEIGHT_M + drop_m) / down;
        let depth_m = if to_m(0.0) < edge_m { to_m(0.0) } else { to_m(drop_m) };
        if down > 0.0 && depth_m < 10.0 { (depth_m * 1000.0) as u16 } else { 0 }
    };
    let pixels_mm = (0..header.height).flat_map(|row| vec![depth_mm(row); header.width as usize]).collect();
    (header, pixels_mm)
}
