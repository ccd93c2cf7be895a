//! What can be wrong with a world, a map, a scenario or a sensor's configuration.

/// A file that cannot be used, or a start that is not free.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The file cannot be read.
    #[error("failed to read {file}: {source}")]
    Read {
        /// The file's path as given.
        file: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The text does not parse, a key is unknown or missing, or a value has the wrong type.
    #[error("{file}:{line}: {what}")]
    Parse {
        /// The file's path as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// A value is out of its bounds.
    #[error("{file}:{line}: {key}: {what}")]
    Value {
        /// The file's path as given.
        file: String,
        /// Line, from 1, of the value or of the table that holds it.
        line: usize,
        /// The key.
        key: &'static str,
        /// What is wrong, with the bounds.
        what: String,
    },
    /// A map's image cannot be used.
    #[error("{file}: {what}")]
    Image {
        /// The image's path.
        file: String,
        /// What is wrong.
        what: String,
    },
    /// Somebody would start inside something.
    #[error("start is not free: {who} at ({x_m:.2}, {y_m:.2}) needs {needed_m:.2} m and has {clearance_m:.2} m")]
    StartBlocked {
        /// Robot or handler.
        who: &'static str,
        /// Place in the world, metres.
        x_m: f64,
        /// Place in the world, metres.
        y_m: f64,
        /// Radius of the disc, metres.
        needed_m: f64,
        /// Distance from the place to the nearest thing, metres.
        clearance_m: f64,
    },
    /// A pose given by an operator is not finite.
    #[error("start pose is not finite")]
    StartNotFinite,
    /// A run has neither a scenario nor a map with a start.
    #[error("neither a scenario nor a map with a start is given")]
    NoScenario,
    /// The project's own world is flat.
    #[error("ramps need --physics mujoco: this world is flat")]
    Ramps,
    /// In the project's own world the handler does nothing but follow, and let the handle go.
    #[error("does = \"snag\" and does = \"pull\" of a [[handler]] need --physics mujoco: here nothing pulls")]
    Disturbances,
    /// Robot and handler find no way in a floor plan.
    #[error("{file}: there is no corridor of {length_m} m with room for robot and handler")]
    NoWay {
        /// The map.
        file: String,
        /// The shortest way of use, metres.
        length_m: f64,
    },
    /// Robot or handler is like none.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// A value of a sensor's or of the physics' configuration that is out of its bounds.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key}: {what}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// What is wrong, with the bounds.
    pub what: String,
}

impl ConfigError {
    /// Refuses a value outside `[min, max]`, or one that is not finite.
    pub(crate) fn check(key: &'static str, value: f64, min: f64, max: f64) -> Result<(), Self> {
        if (min..=max).contains(&value) {
            return Ok(());
        }
        Err(Self { key, what: format!("{value} is not in [{min}, {max}]") })
    }

    /// Refuses a whole number outside `[min, max]`.
    pub(crate) fn check_count(key: &'static str, value: usize, min: usize, max: usize) -> Result<(), Self> {
        if (min..=max).contains(&value) {
            return Ok(());
        }
        Err(Self { key, what: format!("{value} is not in [{min}, {max}]") })
    }
}
