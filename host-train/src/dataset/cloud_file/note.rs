//! What a reader noticed, interpreted or left out.

use crate::words::count;
use serde::Serialize;
use std::fmt;

/// Something that the user of a file should know.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Note {
    /// Points whose coordinates are NaN, infinite or beyond 1e12, which mark what a sensor did not see.
    Dropped {
        /// How many.
        points: usize,
        /// Triangles that had one of them as a corner.
        faces: usize,
    },
    /// An array with the coordinates along its first axis; the longer axis was taken for the points.
    LongerAxis {
        /// Length of the first axis.
        rows: usize,
        /// Length of the second, the number of points.
        columns: usize,
    },
    /// An array of few rows was read as one organised cloud; it may be several clouds.
    Stacked {
        /// Rows.
        clouds: usize,
        /// Points of each.
        of: usize,
    },
    /// The file's count differs from what it holds.
    Count {
        /// What is counted.
        what: &'static str,
        /// Number that the file claims.
        claimed: u64,
        /// Number that was read.
        read: usize,
    },
    /// The file goes on after everything that its header counts.
    Beyond {
        /// By how much.
        bytes: usize,
    },
    /// Numbers are written with a decimal comma.
    DecimalComma,
    /// The first column numbers or names the lines and was left out.
    IndexColumn,
    /// The text is UTF-16.
    Utf16,
    /// Polygons whose outline crosses itself or has no plane; they were divided from their first corner.
    CrossedPolygons {
        /// How many.
        polygons: usize,
    },
    /// Normals that could not be kept: some are undefined, or a vertex has several.
    NormalsLeftOut,
    /// Most vertices of a mesh belong to no face; points are drawn from its faces alone.
    LooseVertices {
        /// How many.
        vertices: usize,
        /// Number of all vertices.
        of: usize,
    },
    /// Vertices with a weight other than 1, homogeneous coordinates.
    Weighted {
        /// How many.
        vertices: usize,
    },
    /// Parts of the file that are not used.
    Ignored {
        /// Their names.
        what: String,
    },
    /// The sensor's place according to the file; it is not used.
    ViewPoint {
        /// In the file's coordinates.
        at: [f64; 3],
    },
    /// A cloud was thinned for the policy.
    Thinned {
        /// Points of the cloud.
        from: usize,
        /// Points that are used.
        to: usize,
    },
    /// Coordinates are far from the origin; they were taken relative to this point.
    Shifted {
        /// The point.
        origin: [f64; 3],
    },
    /// The cloud comes from a depth image, in millimetres.
    Seen {
        /// Pixels of the object with a depth.
        pixels: usize,
        /// Pixels of the object without one.
        without: usize,
        /// Millimetres a unit of depth.
        scale_mm: f64,
    },
    /// Pixels of a depth image with the largest integer of their type, which marks missing measurements.
    Marked {
        /// That integer.
        number: f64,
        /// How many, inside the mask and outside of it.
        pixels: usize,
    },
    /// Coordinates are float32, or on its grid, and so far from the origin that its steps are visible in the shape.
    Coarse {
        /// Step between neighbouring float32 numbers at the largest coordinate, in the file's units.
        step: f64,
    },
    /// The camera's optical axis meets the image plane outside of the image.
    OffCentre {
        /// The principal point, pixels.
        centre: [f32; 2],
        /// Columns and rows of the image.
        size: [usize; 2],
    },
    /// The cloud is from a bag.
    Message {
        /// The topic.
        topic: String,
        /// Number among the topic's messages, from 0.
        number: u64,
        /// The sensor's time stamp: seconds,
        sec: i32,
        /// and nanoseconds.
        nanosec: u32,
    },
    /// The cloud has no faces to draw points from.
    NoFaces,
    /// The last refinement, on many points, did not improve the fit and was dropped.
    NotFiner,
    /// As a source, the cloud fits far better once it is scaled.
    OtherSize {
        /// Size of the source relative to the target.
        times: f32,
    },
    /// As a source, much of the cloud lies off the target, though the pose is called right.
    OffTarget {
        /// Share of its points off the target.
        share: f32,
    },
    /// As a source, its view point lies among its points.
    SeenFromAmong,
    /// As a source of which the surroundings were seen, something was seen behind much of the target.
    SeenThrough {
        /// Share of the target's surface.
        share: f32,
    },
}

impl Note {
    /// The note for bytes after everything that a header counts; whitespace and zeros are only padding.
    pub(super) fn beyond(rest: &[u8]) -> Option<Note> {
        let is_filling = |&byte: &u8| byte == 0 || byte.is_ascii_whitespace();
        let bytes = rest.len();
        (!rest.iter().all(is_filling)).then_some(Note::Beyond { bytes })
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Note::Dropped { points, faces } => {
                let points = count(*points, "invalid point", "invalid points");
                write!(f, "left out {points} (NaN, infinite or beyond 1e12)")?;
                match faces {
                    0 => Ok(()),
                    _ => write!(
                        f,
                        " and with that {}",
                        count(*faces, "triangle", "triangles")
                    ),
                }
            }
            Note::LongerAxis { rows, columns } => write!(
                f,
                "an array of shape ({rows}, {columns}) is read as {columns} points, the longer axis"
            ),
            Note::Stacked { clouds, of } => write!(
                f,
                "an array of shape ({clouds}, {of}, …) is read as one cloud; save clouds of a batch each to a file of its own"
            ),
            Note::Count {
                what,
                claimed,
                read,
            } => write!(
                f,
                "it claims {claimed} {what} and holds {read}; what it holds is read"
            ),
            Note::Beyond { bytes } => write!(
                f,
                "it holds more than its header counts: the last {} not read",
                count(*bytes, "byte is", "bytes are")
            ),
            Note::DecimalComma => write!(f, "numbers are read with a decimal comma"),
            Note::IndexColumn => write!(
                f,
                "the first column numbers the lines, or names them, and is left out"
            ),
            Note::Utf16 => write!(f, "the text is UTF-16"),
            Note::CrossedPolygons { polygons } => write!(
                f,
                "{}, cut from the first corner",
                count(
                    *polygons,
                    "polygon crosses itself",
                    "polygons cross themselves"
                )
            ),
            Note::NormalsLeftOut => write!(
                f,
                "its normals are left out: some are undefined, or differ at one vertex"
            ),
            Note::LooseVertices { vertices, of } => write!(
                f,
                "{vertices} of its {of} vertices are corners of no face and are not used"
            ),
            Note::Weighted { vertices } => write!(
                f,
                "{} a weight other than 1, by which the coordinates are divided",
                count(*vertices, "vertex has", "vertices have")
            ),
            Note::Ignored { what } => write!(f, "not used: {what}"),
            Note::ViewPoint { at: [x, y, z] } => {
                write!(f, "its viewpoint ({x}, {y}, {z}) is not used")
            }
            Note::Thinned { from, to } => {
                write!(f, "{from} points are thinned to {to} for the policy")
            }
            Note::Shifted { origin: [x, y, z] } => {
                write!(f, "coordinates are taken relative to ({x}, {y}, {z})")
            }
            Note::Seen {
                pixels,
                without,
                scale_mm,
            } => write!(
                f,
                "{} in millimetres ({scale_mm} mm a unit of depth); {} no depth",
                count(*pixels, "pixel is a point", "pixels are points"),
                count(*without, "more has", "more have")
            ),
            Note::Marked { number, pixels } => write!(
                f,
                "{} {number}, the largest number that the image can hold, which counts as no depth",
                count(*pixels, "pixel is", "pixels are")
            ),
            Note::Coarse { step } => write!(
                f,
                "its coordinates come in steps of {step}, those of float32 this far from the origin; write them as float64, or take an offset off before"
            ),
            Note::NotFiner => write!(
                f,
                "the last refinement, on many points, made no pose that fits better, and was dropped"
            ),
            Note::OffCentre {
                centre: [x, y],
                size: [width, height],
            } => write!(
                f,
                "the camera's principal point ({x}, {y}) lies outside of the image of {width} x {height} pixels: the camera seems to be that of images of another size; its numbers are pixels of this one"
            ),
            Note::Message {
                topic,
                number,
                sec,
                nanosec,
            } => write!(f, "message {number} of {topic}, stamped {sec}.{nanosec:09}"),
            Note::NoFaces => write!(
                f,
                "it has points and no faces; normals are estimated from neighbouring points"
            ),
            Note::OtherSize { times } => write!(
                f,
                "it is {times:.2} times as large as the target: check its unit or calibration"
            ),
            Note::OffTarget { share } => write!(
                f,
                "{:.0} % of it lies off the target: where they overlap in part that is to be expected, else something more is in view, or it is another part",
                100.0 * share
            ),
            Note::SeenFromAmong => write!(
                f,
                "the view point lies among its points and is not used: is it in the cloud's coordinates?"
            ),
            Note::SeenThrough { share } => write!(
                f,
                "{:.0} % of the target would stand where something was seen behind it: the pose is wrong, or the part in view is smaller, has less to it, or is another one",
                100.0 * share
            ),
        }
    }
}
