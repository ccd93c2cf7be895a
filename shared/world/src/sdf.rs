//! Worlds of Gazebo: what blocks in an SDF file, as prisms.
//!
//! Cylinders, boxes and spheres that stand upright become prisms; a level plane is the floor. Whatever else could block
//! is refused by its name, so that nothing is left out silently. Poses are x y z roll pitch yaw, metres and radians
//! (SDF 1.6, `pose`).

use std::collections::BTreeMap;

use guidance::se2::{Point, Se2};
use nalgebra::Vector2;
use roxmltree::{Document, Node};

use crate::{Prism, World, WorldError};

/// A smaller rotation out of the plane does not count, radians.
const UPRIGHT_RAD: f64 = 1e-6;
/// No obstacle is larger, metres.
const SIZE_MAX_M: f64 = 1e3;
/// No obstacle is farther from the origin, metres.
const PLACE_MAX_M: f64 = 1e4;
/// Models in models are no deeper.
const MODELS_DEEP: usize = 16;
/// What a world may hold beside models and its state. None of it blocks.
const HARMLESS: [&str; 12] = [
    "light",
    "gravity",
    "magnetic_field",
    "atmosphere",
    "physics",
    "scene",
    "spherical_coordinates",
    "wind",
    "gui",
    "audio",
    "plugin",
    "model",
];

/// The world of an SDF file's text, which `file` names in errors. It has no ceiling below 10 m.
///
/// # Errors
/// Where the text is no SDF world, or holds something that is not understood. The error names file, line and element.
pub fn parse(file: &str, text: &str) -> Result<World, WorldError> {
    let document = Document::parse(text).map_err(|error| WorldError::Parse {
        file: file.to_owned(),
        line: error.pos().row as usize,
        what: error.to_string(),
    })?;
    Sdf { file, document: &document }.world()
}

/// The ceiling of a place in the open, metres.
const OPEN_M: f64 = 10.0;

struct Sdf<'a> {
    file: &'a str,
    document: &'a Document<'a>,
}

/// A place with a height: a pose that stands upright.
#[derive(Debug, Clone, Copy)]
struct Upright {
    pose: Se2,
    z_m: f64,
}

impl Upright {
    const ORIGIN: fn() -> Self = || Self { pose: Se2::identity(), z_m: 0.0 };

    fn then(&self, next: &Self) -> Self {
        Self { pose: self.pose * next.pose, z_m: self.z_m + next.z_m }
    }
}

impl Sdf<'_> {
    fn refuse(&self, node: Node<'_, '_>, what: impl Into<String>) -> WorldError {
        let line = self.document.text_pos_at(node.range().start).row as usize;
        WorldError::Parse { file: self.file.to_owned(), line, what: what.into() }
    }

    fn world(&self) -> Result<World, WorldError> {
        let root = self.document.root_element();
        let world = children(root).find(|node| node.has_tag_name("world"));
        let Some(world) = world.filter(|_| root.has_tag_name("sdf")) else {
            return Err(self.refuse(root, "an SDF file with a <world> is wanted"));
        };
        let mut prisms = Vec::new();
        let moved = self.moved(world)?;
        let mut has_model = false;
        for child in children(world) {
            match child.tag_name().name() {
                "model" => {
                    has_model = true;
                    let name = child.attribute("name").unwrap_or_default();
                    self.model(child, &Upright::ORIGIN(), moved.get(name).copied(), &mut prisms)?;
                }
                "state" => {}
                name if HARMLESS.contains(&name) => {}
                name => return Err(self.refuse(child, format!("<{name}> is not understood, and may block"))),
            }
        }
        if !has_model {
            return Err(self.refuse(world, "the <world> has no <model>"));
        }
        Ok(World::new(OPEN_M, prisms))
    }

    /// Where the state of the world says that models are: it outdoes their own poses.
    fn moved(&self, world: Node<'_, '_>) -> Result<BTreeMap<String, Upright>, WorldError> {
        let states = children(world).filter(|node| node.has_tag_name("state"));
        let mut moved = BTreeMap::new();
        for child in states.flat_map(children) {
            match child.tag_name().name() {
                "model" => {
                    self.has_scale_of_1(child)?;
                    let name = child.attribute("name").unwrap_or_default();
                    moved.insert(name.to_owned(), self.pose(child)?);
                }
                name @ ("insertions" | "deletions") if children(child).next().is_some() => {
                    return Err(self.refuse(child, format!("<{name}> in a <state>: these models are not read")));
                }
                _ => {}
            }
        }
        Ok(moved)
    }

    /// Refuses a model that the state scales.
    fn has_scale_of_1(&self, model: Node<'_, '_>) -> Result<(), WorldError> {
        let Some(scale) = children(model).find(|node| node.has_tag_name("scale")) else { return Ok(()) };
        match self.numbers::<3>(scale, scale.text().unwrap_or_default())? {
            [1.0, 1.0, 1.0] => Ok(()),
            _ => Err(self.refuse(scale, "<scale>: only 1 1 1 is understood")),
        }
    }

    fn model(
        &self,
        model: Node<'_, '_>,
        at: &Upright,
        moved: Option<Upright>,
        prisms: &mut Vec<Prism>,
    ) -> Result<(), WorldError> {
        if model.ancestors().filter(|node| node.has_tag_name("model")).count() > MODELS_DEEP {
            return Err(self.refuse(model, format!("<model>: over {MODELS_DEEP} models within each other")));
        }
        let own = self.pose(model)?;
        let at = at.then(&moved.unwrap_or(own));
        for child in children(model) {
            match child.tag_name().name() {
                "link" => self.link(child, &at, prisms)?,
                "model" => self.model(child, &at, None, prisms)?,
                "include" => return Err(self.refuse(child, "<include> in a model: its file is not read")),
                _ => {}
            }
        }
        Ok(())
    }

    fn link(&self, link: Node<'_, '_>, at: &Upright, prisms: &mut Vec<Prism>) -> Result<(), WorldError> {
        let at = at.then(&self.pose(link)?);
        for collision in children(link).filter(|node| node.has_tag_name("collision")) {
            let at = at.then(&self.pose(collision)?);
            let geometry = children(collision).find(|node| node.has_tag_name("geometry"));
            let Some(shape) = geometry.and_then(|geometry| children(geometry).next()) else {
                return Err(self.refuse(collision, "a <collision> without a shape in its <geometry>"));
            };
            prisms.extend(self.shape(shape, &at)?);
        }
        Ok(())
    }

    /// The prism of a shape; none where it lies under the floor, or is the floor.
    fn shape(&self, shape: Node<'_, '_>, at: &Upright) -> Result<Option<Prism>, WorldError> {
        let place = Point::from(at.pose.translation.vector);
        // Sums of finite numbers may be infinite, or no number.
        let is_near = |m: f64| m <= PLACE_MAX_M;
        if !(is_near(place.coords.norm()) && is_near(at.z_m.abs())) {
            return Err(self.refuse(shape, format!("a shape over {PLACE_MAX_M} m from the origin")));
        }
        let z_m = |height_m: f64| [(at.z_m - height_m / 2.0).max(0.0), at.z_m + height_m / 2.0];
        let prism = match shape.tag_name().name() {
            "cylinder" => {
                let [radius_m] = self.sizes(shape, "radius")?;
                let [length_m] = self.sizes(shape, "length")?;
                Prism::pillar(place, radius_m, z_m(length_m))
            }
            "sphere" => {
                let [radius_m] = self.sizes(shape, "radius")?;
                Prism::pillar(place, radius_m, z_m(2.0 * radius_m))
            }
            "box" => {
                let [x_m, y_m, height_m] = self.sizes(shape, "size")?;
                Prism::cuboid(place, [x_m, y_m], at.pose.rotation.angle(), z_m(height_m))
            }
            "plane" => return self.floor(shape, at).map(|()| None),
            name => return Err(self.refuse(shape, format!("<{name}>: a shape that is not understood"))),
        };
        Ok(Some(prism).filter(|prism| prism.z1_m > 0.0))
    }

    /// Accepts a plane that is the floor.
    fn floor(&self, plane: Node<'_, '_>, at: &Upright) -> Result<(), WorldError> {
        let normal = match children(plane).find(|node| node.has_tag_name("normal")) {
            Some(normal) => self.numbers::<3>(normal, normal.text().unwrap_or_default())?,
            None => [0.0, 0.0, 1.0],
        };
        if normal[0] != 0.0 || normal[1] != 0.0 || normal[2] <= 0.0 || at.z_m.abs() > UPRIGHT_RAD {
            return Err(self.refuse(plane, "<plane>: only the level floor at z = 0 is understood"));
        }
        Ok(())
    }

    /// The lengths that a child of a shape tells, metres.
    fn sizes<const N: usize>(&self, shape: Node<'_, '_>, name: &str) -> Result<[f64; N], WorldError> {
        let Some(node) = children(shape).find(|node| node.has_tag_name(name)) else {
            return Err(self.refuse(shape, format!("<{}> has no <{name}>", shape.tag_name().name())));
        };
        let sizes = self.numbers::<N>(node, node.text().unwrap_or_default())?;
        match sizes.iter().find(|size| !(**size > 0.0 && **size <= SIZE_MAX_M)) {
            Some(size) => Err(self.refuse(node, format!("<{name}>: {size} is not over 0 and at most {SIZE_MAX_M}"))),
            None => Ok(sizes),
        }
    }

    /// The pose that an element states; the origin where it states none.
    fn pose(&self, of: Node<'_, '_>) -> Result<Upright, WorldError> {
        let Some(pose) = children(of).find(|node| node.has_tag_name("pose")) else { return Ok(Upright::ORIGIN()) };
        let named = ["frame", "relative_to"].into_iter().filter_map(|key| pose.attribute(key));
        if let Some(frame) = named.into_iter().find(|frame| !frame.is_empty()) {
            return Err(self.refuse(pose, format!("<pose> relative to {frame:?}: frames are not understood")));
        }
        let [x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad] = self.numbers(pose, pose.text().unwrap_or("0 0 0 0 0 0"))?;
        if roll_rad.abs() > UPRIGHT_RAD || pitch_rad.abs() > UPRIGHT_RAD {
            return Err(self.refuse(pose, "<pose> with roll or pitch: only what stands upright is understood"));
        }
        Ok(Upright { pose: Se2::new(Vector2::new(x_m, y_m), yaw_rad), z_m })
    }

    /// Exactly N finite numbers of an element's text.
    fn numbers<const N: usize>(&self, node: Node<'_, '_>, text: &str) -> Result<[f64; N], WorldError> {
        let name = node.tag_name().name();
        let parsed = text.split_whitespace().map(|word| {
            let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| self.refuse(node, format!("<{name}>: {word:?} is no finite number")))
        });
        let numbers = parsed.collect::<Result<Vec<_>, _>>()?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| self.refuse(node, format!("<{name}> has {count} numbers, not {N}")))
    }
}

/// The elements within an element.
fn children<'a, 'input>(node: Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children().filter(Node::is_element)
}

#[cfg(test)]
mod tests {
    use super::parse;
    use guidance::se2::Point;

    const WORLD: &str = "<sdf version='1.6'><world name='default'>
<light name='sun' type='directional'><pose frame=''>0 0 10 0 -0 0</pose></light>
<model name='ground_plane'><link name='link'><collision name='c'><geometry>
<plane><normal>0 0 1</normal><size>100 100</size></plane></geometry></collision></link></model>
<model name='pillar'><pose>1 2 0 0 0 0</pose><link name='link'><collision name='c'><geometry>
<cylinder><radius>0.5</radius><length>1</length></cylinder></geometry></collision></link></model>
<model name='crate'><pose>4 0 0.5 0 0 1.5707963267948966</pose><link name='link'><pose>1 0 0 0 0 0</pose>
<collision name='c'><geometry><box><size>2 0.2 1</size></box></geometry></collision></link></model>
<model name='buried'><pose>0 0 -2 0 0 0</pose><link name='link'><collision name='c'><geometry>
<sphere><radius>1</radius></sphere></geometry></collision></link></model>
<state world_name='default'><model name='pillar'><pose>-3 2 0 0 0 0</pose></model></state>
</world></sdf>";

    #[test]
    fn shapes_stand_where_the_state_and_the_poses_say() {
        let world = parse("w.world", WORLD).expect("a world");
        let prisms = world.prisms();
        assert_eq!(prisms.len(), 2, "a plane is the floor, and what is under it does not block");
        assert!(prisms[0].contains(Point::new(-3.0, 2.45)) && !prisms[0].contains(Point::new(1.0, 2.0)));
        assert_eq!([prisms[0].z0_m, prisms[0].z1_m], [0.0, 0.5], "half of it is under the floor");
        // The crate's link is 1 m along its x axis, which points along y; its long side, too.
        assert!(prisms[1].contains(Point::new(4.0, 1.95)) && !prisms[1].contains(Point::new(4.2, 1.0)));
        assert_eq!([prisms[1].z0_m, prisms[1].z1_m], [0.0, 1.0]);
    }

    #[test]
    fn what_is_not_understood_is_refused_with_line_and_element() {
        for (from, to, why) in [
            ("<cylinder>", "<mesh><uri>a.dae</uri></mesh><cylinder>", "w.world:6: <mesh>: a shape"),
            ("<light", "<actor name='a'/><light", "w.world:2: <actor> is not understood"),
            ("<pose>1 2 0 0 0 0", "<pose>1 nan 0 0 0 0", "w.world:5: <pose>: \"nan\" is no finite number"),
            ("<pose>1 2 0 0 0 0", "<pose>1 2 0", "w.world:5: <pose> has 3 numbers, not 6"),
            ("<pose>4 0 0.5 0 0 1", "<pose>4 0 0.5 0.2 0 1", "w.world:7: <pose> with roll or pitch"),
            ("<pose>1 0 0 0 0 0", "<pose relative_to='x'>1 0 0 0 0 0", "w.world:7: <pose> relative to \"x\""),
            ("<radius>0.5", "<radius>-0.5", "w.world:6: <radius>: -0.5 is not over 0"),
            ("<length>1</length>", "", "w.world:6: <cylinder> has no <length>"),
            ("<normal>0 0 1", "<normal>1 0 0", "w.world:4: <plane>: only the level floor"),
            ("<pose>-3 2 0 0", "<pose>-3 2 1e308 0", "w.world:6: a shape over 10000 m from the origin"),
            ("<pose>4 0 0.5 0 0 1", "<pose>1e308 1e308 0.5 0 0 1", "w.world:8: a shape over 10000 m"),
            ("<pose>-3 2 0", "<scale>1 1 2</scale><pose>-3 2 0", "w.world:11: <scale>: only 1 1 1"),
            ("</state>", "<insertions><model name='m'/></insertions></state>", "w.world:11: <insertions> in a <state>"),
            ("<world name='default'>", "<w>", "w.world:"),
            ("</world></sdf>", "", "w.world:"),
        ] {
            assert!(WORLD.contains(from), "{from}");
            let error = parse("w.world", &WORLD.replacen(from, to, 1)).expect_err(why).to_string();
            assert!(error.contains(why), "{error}\nnot {why}");
        }
        // Sums of poses that are finite each.
        let far = "<pose>1e308 1e308 0 0 0 0.8</pose>";
        let nested = |count: usize, pose: &str| {
            let (open, close) = (format!("<model>{pose}").repeat(count), "</model>".repeat(count));
            format!(
                "<sdf><world>{open}<link><collision><geometry><sphere><radius>1</radius></sphere></geometry>\
                 </collision></link>{close}</world></sdf>"
            )
        };
        assert_eq!(parse("n", &nested(16, "")).expect("a world").prisms().len(), 1);
        let error = |text: &str| parse("n", text).expect_err("refused").to_string();
        assert_eq!(error(&nested(9, far)), "n:1: a shape over 10000 m from the origin");
        assert_eq!(error(&nested(10_000, "")), "n:1: <model>: over 16 models within each other");
        let empty = "<sdf><world name='w'><light/></world></sdf>";
        assert_eq!(parse("e", empty).expect_err("empty").to_string(), "e:1: the <world> has no <model>");
    }
}
