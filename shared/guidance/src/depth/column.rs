//! What one column of a depth frame shows: the nearest obstacle, how far nothing is, and where the floor ends.

/// Nothing above this height can hit a person, metres.
const HEAD_M: f64 = 1.90;
/// Pixels that say nothing hide something that is higher than this, metres.
const HIDDEN_M: f64 = 0.05;
/// A drop shows at least this many pixels below the floor. One alone is noise.
const LOW_MIN: u32 = 2;
/// Floor may fall at the slope of a ramp of 1:12 where a drop hides it.
const RAMP: f64 = 1.0 / 12.0;
/// Floor goes on over a gap of this many rows of pixels, or of this length, metres. Over pixels that say nothing, or
/// one that lies below, it goes on for the length alone.
const GAP_ROWS: f64 = 3.0;
const GAP_M: f64 = 0.1;
/// A step down that can be taken hides at most so much of the floor right behind it where that counts as floor, metres:
/// the camera has to come near enough. A wider gap there would not be seen from farther off.
const HIDDEN_MAX_M: f64 = 0.18;

/// Of a hole that is too narrow for its bottom to show, the far lip is at most so far behind the near one, metres.
const NARROW_M: f64 = 0.8;
/// Its lips are equally high, give or take this, metres.
const LIPS_M: f64 = 0.03;
/// Its far wall is seen to be lower than them by this, metres, and an increase per metre of distance.
const WALL_M: f64 = 0.04;
const WALL_PER_M: f64 = 0.01;
/// Two pixels see that wall. The higher one is lower than the lips by this, metres.
const SECOND_M: f64 = 0.02;
/// Floor that falls less towards the camera may be a lip: the steepest ramp, and the error of the attitude.
const LIP_SLOPE: f64 = 0.14;

/// The first floor lies so near to where the lowest rays reach the floor, metres,
const FIRST_M: f64 = 0.25;
/// and so near to the height on which the robot stands, metres.
const LEVEL_M: f64 = 0.03;

/// The camera, as all columns of a frame look at the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    /// Its height over the floor, metres.
    pub height_m: f64,
    /// Distance between two rows of pixels on the floor at 1 m, metres. It grows with the distance's square.
    pub apart_at_1_m: f64,
}

impl Eye {
    /// Floor that is seen goes on over a gap of this length at a distance, metres.
    fn gap_m(&self, along_m: f64) -> f64 {
        GAP_M.max(GAP_ROWS * self.apart_at_1_m * along_m * along_m)
    }
}

/// What a pixel sees, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// Along the camera's axis over the floor, and to the left of it.
    pub along_m: f64,
    pub left_m: f64,
    /// Height over the camera.
    pub rise_m: f64,
    /// Height over the floor. Below `floor_m` it is floor.
    pub height_m: f64,
    pub floor_m: f64,
    /// Height over the lowest floor that is possible here. More than `drop_m` below it, the floor has dropped.
    pub over_lowest_m: f64,
    pub drop_m: f64,
    /// How much higher than the first floor the floor is here, for the steps that can be taken before it.
    pub level_m: f64,
}

/// A place on the floor: along the camera's axis and to the left of it, and its height over the camera, metres.
#[derive(Debug, Clone, Copy)]
struct Place {
    along_m: f64,
    left_m: f64,
    /// Without the steps that can be taken before it.
    rise_m: f64,
    level_m: f64,
}

impl Place {
    /// How much lower another place lies, metres. What is known of steps may explain a fall, and never makes one of
    /// floor that lies equally high.
    fn falls_m(&self, to: &Self) -> f64 {
        let fall_m = self.rise_m - to.rise_m;
        fall_m.min(fall_m + self.level_m - to.level_m)
    }
}

/// No floor yet.
const NONE: Place = Place { along_m: f64::INFINITY, left_m: 0.0, rise_m: f64::INFINITY, level_m: 0.0 };

/// One column of the image. It is looked at from its top to its bottom, so from far floor to near floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    /// Tangent of the angle to the left of the camera's axis.
    pub left: f64,
    /// The nearest obstacle: along the camera's axis over the floor, and to the left of it, metres.
    pub near_m: f64,
    pub near_left_m: f64,
    /// Height of that over the camera, metres.
    pub near_rise_m: f64,
    /// Tangent of the elevation of its highest ray that says something: what hangs higher is out of view.
    pub top: f64,
    /// Nothing between floor and head is nearer, as far as the image reaches up, metres.
    pub free_m: f64,
    /// How far its rays reach within the band between floor and head, metres.
    far_m: f64,
    /// From here on its rays reach down to the floor, metres.
    pub floor_m: f64,
    /// The nearest edge beyond which the floor drops, the last floor before it: along the camera's axis, and to its
    /// left, metres.
    pub edge_m: f64,
    pub edge_left_m: f64,
    /// The nearest floor that is seen without a gap: from here to here, metres.
    seen_m: [f64; 2],
    /// The last two places of the floor, the nearer one first.
    floors: [Place; 2],
    /// The last of them from which the floor falls no more than a ramp does: where a hole may end.
    lip: Place,
    /// Pixels below the floor since the last floor, where the last of their rays passes through the floor's level, and
    /// the least height of them over the camera, metres.
    low: u32,
    missing: Place,
    lowest_m: f64,
    /// Pixels in a row, up to here, that say nothing.
    unknown: u32,
    /// Pixels that say something.
    pub known: u32,
}

impl Column {
    pub fn new(left: f64) -> Self {
        let none = f64::INFINITY;
        Self {
            left,
            near_m: none,
            near_left_m: none,
            near_rise_m: 0.0,
            top: f64::NEG_INFINITY,
            free_m: none,
            far_m: 0.0,
            floor_m: none,
            edge_m: none,
            edge_left_m: 0.0,
            seen_m: [none, 0.0],
            floors: [NONE; 2],
            lip: NONE,
            low: 0,
            missing: NONE,
            lowest_m: none,
            unknown: 0,
            known: 0,
        }
    }

    /// A pixel that says nothing. A run of them hides what is higher than [`HIDDEN_M`] from where it is so wide on.
    pub fn take_unknown(&mut self, fy_px: f64) {
        self.unknown += 1;
        self.free_m = self.free_m.min(HIDDEN_M * fy_px / f64::from(self.unknown));
    }

    /// A pixel that says something; `agrees` tells whether its neighbours are about as near.
    // Within the loop over a column's pixels the compiler keeps what it knows of the column in registers.
    #[inline(always)]
    pub fn take(&mut self, pixel: &Pixel, eye: &Eye, agrees: impl FnOnce() -> bool) {
        self.known += 1;
        let unknown = std::mem::take(&mut self.unknown);
        let Pixel { along_m, left_m, rise_m, height_m, floor_m, over_lowest_m, drop_m, level_m } = *pixel;
        // The share of the ray after which it passes a height on its way down.
        let share = |edge_m: f64| ((edge_m - eye.height_m) / (height_m - eye.height_m)).clamp(0.0, 1.0);
        if height_m < floor_m {
            let reaches_m = along_m * share(floor_m);
            (self.far_m, self.floor_m) = (self.far_m.max(reaches_m), self.floor_m.min(reaches_m));
            if over_lowest_m >= -drop_m {
                self.take_floor(pixel, eye, unknown > 1);
            } else if agrees() {
                self.low += 1;
                self.lowest_m = self.lowest_m.min(rise_m);
                let (along_m, left_m) = (along_m * share(0.0), left_m * share(0.0));
                self.missing = Place { along_m, left_m, rise_m: rise_m - level_m, level_m };
            }
            return;
        }
        if height_m > HEAD_M {
            self.far_m = self.far_m.max(along_m * share(HEAD_M));
            return;
        }
        self.far_m = self.far_m.max(along_m);
        // The foot of what stands here is higher than the floor that it hides. Most of the time there is nothing to
        // write: this saves time and changes nothing.
        if self.floors[0].along_m.is_finite() {
            (self.floors, self.lip) = ([NONE; 2], NONE);
        }
        if along_m >= self.near_m {
            return;
        }
        self.free_m = self.free_m.min(along_m);
        if agrees() {
            (self.near_m, self.near_left_m, self.near_rise_m) = (along_m, left_m, rise_m);
        }
    }

    /// Floor. It ends here where pixels below it came before, or floor that lies lower than a ramp leads to.
    /// `is_doubtful`: pixels between said nothing.
    fn take_floor(&mut self, pixel: &Pixel, eye: &Eye, is_doubtful: bool) {
        let Pixel { along_m, left_m, drop_m, level_m, .. } = *pixel;
        let rise_m = pixel.rise_m - level_m;
        let here = Place { along_m, left_m, rise_m, level_m };
        let is_lower = |floor: &Place| here.falls_m(floor) > drop_m + RAMP * (floor.along_m - along_m);
        let is_dropped = self.low >= LOW_MIN && pixel.rise_m - self.lowest_m > drop_m;
        let drops = is_dropped || self.floors.iter().all(is_lower) || self.ends_hole(&here, eye);
        if drops {
            (self.edge_m, self.edge_left_m) = (along_m, left_m);
        }
        // A step down that can be taken hides the floor right behind it, by no more than its height tells.
        let lower_m = (level_m - self.floors[0].level_m).max(0.0);
        let gap_m = if lower_m > 0.0 {
            (lower_m / eye.height_m * along_m + eye.apart_at_1_m * along_m * along_m).min(HIDDEN_MAX_M)
        } else if is_doubtful || self.low > 0 {
            GAP_M
        } else {
            eye.gap_m(along_m)
        };
        let goes_on = !drops && self.seen_m[0] - along_m <= gap_m;
        self.seen_m = if goes_on { [self.seen_m[0].min(along_m), self.seen_m[1]] } else { [along_m; 2] };
        (self.low, self.lowest_m) = (0, f64::INFINITY);
        let falls = rise_m < self.lip.rise_m - LIP_SLOPE * (self.lip.along_m - along_m);
        if drops || !falls || self.lip.rise_m.is_infinite() {
            self.lip = here;
        }
        // What lies beyond an edge says nothing about the floor before it.
        self.floors = if drops { [here, NONE] } else { [here, self.floors[0]] };
    }

    /// Whether a narrow hole lies behind this floor: of what is in it, only the far wall shows.
    fn ends_hole(&self, here: &Place, eye: &Eye) -> bool {
        let wide_m = self.lip.along_m - here.along_m;
        let is_level = (self.lip.rise_m - here.rise_m).abs() <= LIPS_M + RAMP * wide_m;
        let gap_m = self.floors[0].along_m - here.along_m;
        let is_gap = self.low > 0 || gap_m > eye.gap_m(here.along_m);
        let behind = if self.low > 0 { [&self.missing, &self.floors[0]] } else { [&self.floors[0], &self.floors[1]] };
        let [lowest_m, second_m] = behind.map(|place| here.falls_m(place));
        let needed_m = WALL_M + WALL_PER_M * here.along_m + RAMP * wide_m;
        let is_wall = lowest_m > needed_m && second_m > SECOND_M;
        wide_m <= NARROW_M && is_level && is_gap && is_wall
    }

    /// No pixel comes any more.
    pub fn end(&mut self) {
        self.free_m = self.free_m.min(self.near_m).min(self.far_m);
        if self.low >= LOW_MIN {
            // The floor before it is below the image.
            (self.edge_m, self.edge_left_m) = (self.missing.along_m, self.missing.left_m);
            self.seen_m = [f64::INFINITY, 0.0];
        }
    }

    /// From where on its rays reach down to the floor, metres; infinite where none does.
    pub fn first_floor_m(&self) -> f64 {
        self.floor_m
    }

    /// Whether it sees floor there, as high as the floor on which a robot stands whose camera is so high, metres.
    pub fn is_level_from_first(&self, camera_m: f64) -> bool {
        let over_m = self.floors[0].rise_m + self.floors[0].level_m + camera_m;
        self.seen_m[0] <= self.floor_m + FIRST_M && self.near_m > self.seen_m[0] && over_m.abs() <= LEVEL_M
    }

    /// Whether the nearest floor that is seen begins within a distance along the camera's axis, metres.
    pub fn sees_floor_within(&self, along_m: f64) -> bool {
        self.seen_m[0] < along_m
    }

    /// Whether floor is seen at a distance along the camera's axis and on for `beyond_m`, metres.
    pub fn sees_floor(&self, along_m: f64, beyond_m: f64) -> bool {
        self.seen_m[0] <= along_m && along_m + beyond_m <= self.seen_m[1] && self.near_m > along_m
    }
}
