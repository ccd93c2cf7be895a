//! Values on the command line: what each may be, and what is said of one that is wrong.

use messages::Pose2;
use settings::{Millis, PhysicsKind, SimulatedNoise};

/// A field of view, degrees.
pub fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse::<f64>().ok().filter(|degrees| (10.0..=360.0).contains(degrees));
    degrees.ok_or_else(|| "a field of view is 10 to 360 degrees".to_owned())
}

/// A pace: 0 is as fast as it goes.
pub fn speed(text: &str) -> Result<f64, String> {
    let speed: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if speed == 0.0 || (0.01..=1e6).contains(&speed) {
        return Ok(speed);
    }
    Err("not 0 (as fast as it goes) or 0.01 and more".to_owned())
}

/// The name of a run.
pub fn run_name(text: &str) -> Result<String, String> {
    transport::check_run_name(text).map(|()| text.to_owned())
}

/// A number of times.
pub fn times(text: &str) -> Result<u32, String> {
    text.parse().map_err(|_| "it is no number of times; the recording stands before --loop".to_owned())
}

/// A time with its unit.
pub fn duration(text: &str) -> Result<Millis, String> {
    Millis::try_from(text.to_owned())
}

/// One of these words.
fn word<T: Copy>(text: &str, words: &[(&str, T)]) -> Result<T, String> {
    let found = words.iter().find(|(word, _)| *word == text);
    found.map(|(_, meant)| *meant).ok_or_else(|| {
        let known: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        format!("known: {}", known.join(", "))
    })
}

/// What moves robot and handler.
pub fn physics(text: &str) -> Result<PhysicsKind, String> {
    word(text, &[("flat", PhysicsKind::Flat), ("mujoco", PhysicsKind::Mujoco)])
}

/// How real the robot of the flat world is.
pub fn noise(text: &str) -> Result<SimulatedNoise, String> {
    word(text, &[("noisy", SimulatedNoise::Noisy), ("legged", SimulatedNoise::Legged)])
}

/// `x,y,yaw`: metres, metres, and radians or, with "deg" behind it, degrees.
pub fn start(text: &str) -> Result<Pose2, String> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let [x, y, yaw] = parts[..] else { return Err("a start is x,y,yaw, such as 3,1.5,0".to_owned()) };
    let number = |what: &str, text: &str| -> Result<f64, String> {
        text.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(|| format!("{what} \"{text}\" is not a number"))
    };
    let yaw_rad = match yaw.strip_suffix("deg") {
        Some(degrees) => number("yaw", degrees.trim_end())?.to_radians(),
        None => number("yaw", yaw)?,
    };
    if yaw_rad.abs() > std::f64::consts::TAU {
        return Err(format!("yaw {yaw} is over a whole turn; it is in radians, or say {yaw}deg"));
    }
    let place = |what: &str, text: &str| {
        number(what, text)
            .and_then(|n| if n.abs() <= 1e6 { Ok(n) } else { Err(format!("{what} {text} is over 1e6 m")) })
    };
    Ok(Pose2::new(place("x", x)?, place("y", y)?, guidance::se2::wrap_angle(yaw_rad)))
}

#[cfg(test)]
mod tests {
    use super::{noise, physics, start};

    #[test]
    fn a_wrong_start_says_what_is_wrong() {
        for (text, what) in [
            ("1,2", "x,y,yaw"),
            ("1,2,3,4", "x,y,yaw"),
            ("a,2,0", "x \"a\""),
            ("1,inf,0", "y \"inf\""),
            ("1e30,0,0", "over 1e6 m"),
        ] {
            assert!(start(text).expect_err(text).contains(what), "{text}");
        }
        assert!(start("1,2,90").expect_err("over a turn").contains("90deg"));
    }

    #[test]
    fn a_wrong_word_is_answered_with_the_known_ones() {
        assert_eq!(physics("round"), Err("known: flat, mujoco".to_owned()));
        assert_eq!(noise("loud"), Err("known: noisy, legged".to_owned()));
    }
}
