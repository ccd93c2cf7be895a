//! What one column of a depth frame shows: the nearest obstacle, how far nothing is, and where the floor ends.

/// What is higher is over everybody's head, metres.
const HEAD_M: f64 = 1.90;
/// Pixels that say nothing hide something that is higher than this, metres.
const HIDDEN_M: f64 = 0.05;
/// So many pixels in a row below the floor are a drop; one alone is noise.
const LOW_MIN: u32 = 2;
/// Floor goes on over a gap of this many rows of pixels, or of this length, metres: the rays of a tilted camera leave a
/// column out in some of the rows.
const GAP_ROWS: f64 = 3.0;
const GAP_M: f64 = 0.1;

/// The camera, as all columns of a frame look at the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    /// Its height over the floor, metres.
    pub height_m: f64,
    /// Distance between two rows of pixels on the floor at 1 m, metres. It grows with the distance's square.
    pub apart_at_1_m: f64,
}

/// What a pixel sees: how far along the camera's axis over the floor and to the left of it, how high over the camera
/// and over the floor, up to which height that is floor, and how far below the floor it is none, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    pub along_m: f64,
    pub left_m: f64,
    pub rise_m: f64,
    pub height_m: f64,
    pub floor_m: f64,
    pub drop_m: f64,
}

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
    /// The nearest edge beyond which the floor drops: the last floor before it, metres.
    pub edge_m: f64,
    /// The nearest floor that is seen without a gap: from here to here, metres.
    seen_m: [f64; 2],
    /// Pixels below the floor in a row, up to here, and where the last of their rays passes through the floor's level,
    /// metres.
    low: u32,
    missing_m: f64,
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
            seen_m: [none, 0.0],
            low: 0,
            missing_m: none,
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
    pub fn take(&mut self, pixel: &Pixel, eye: &Eye, agrees: impl FnOnce() -> bool) {
        (self.unknown, self.known) = (0, self.known + 1);
        let Pixel { along_m, left_m, rise_m, height_m, floor_m, drop_m } = *pixel;
        // Where the ray passes a height on its way down.
        let passes_m = |edge_m: f64| along_m * ((edge_m - eye.height_m) / (height_m - eye.height_m)).clamp(0.0, 1.0);
        if height_m < floor_m {
            self.far_m = self.far_m.max(passes_m(floor_m));
            self.floor_m = self.floor_m.min(passes_m(floor_m));
            if height_m >= -drop_m {
                self.take_floor(along_m, eye.apart_at_1_m * along_m * along_m);
            } else if agrees() {
                (self.low, self.missing_m) = (self.low + 1, passes_m(0.0));
            }
            return;
        }
        if height_m > HEAD_M {
            self.far_m = self.far_m.max(passes_m(HEAD_M));
            return;
        }
        self.far_m = self.far_m.max(along_m);
        if along_m >= self.near_m {
            return;
        }
        self.free_m = self.free_m.min(along_m);
        if agrees() {
            (self.near_m, self.near_left_m, self.near_rise_m) = (along_m, left_m, rise_m);
        }
    }

    /// Floor, where two rows of pixels are so far apart. It ends here where pixels below it came before.
    fn take_floor(&mut self, along_m: f64, apart_m: f64) {
        if self.low >= LOW_MIN {
            self.edge_m = along_m;
        }
        let goes_on = self.low < LOW_MIN && self.seen_m[0] - along_m <= (GAP_ROWS * apart_m).max(GAP_M);
        self.seen_m = if goes_on { [self.seen_m[0].min(along_m), self.seen_m[1]] } else { [along_m; 2] };
        self.low = 0;
    }

    /// No pixel comes any more.
    pub fn end(&mut self) {
        self.free_m = self.free_m.min(self.near_m).min(self.far_m);
        if self.low >= LOW_MIN {
            // The floor before it is below the image.
            (self.edge_m, self.seen_m) = (self.missing_m, [f64::INFINITY, 0.0]);
        }
    }

    /// Whether floor is seen at a distance along the camera's axis and on for `beyond_m`, metres.
    pub fn sees_floor(&self, along_m: f64, beyond_m: f64) -> bool {
        self.seen_m[0] <= along_m && along_m + beyond_m <= self.seen_m[1] && self.near_m > along_m
    }
}
