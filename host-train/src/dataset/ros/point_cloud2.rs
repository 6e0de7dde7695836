//! `sensor_msgs/PointCloud2`, with fields in the order of its definition in `common_interfaces`, and the points in
//! it, whatever padding and other fields there are.

use crate::dataset::Point;
use crate::pose64::Position;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// `builtin_interfaces/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds beyond them.
    pub nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Time of the measurement.
    pub stamp: Time,
    /// Frame of the coordinates.
    pub frame_id: String,
}

/// `sensor_msgs/PointField`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointField {
    /// Name, such as `x`.
    pub name: String,
    /// Offset in a point, bytes.
    pub offset: u32,
    /// Number type, one of the definition's constants.
    pub datatype: u8,
    /// Number of values.
    pub count: u32,
}

/// `sensor_msgs/PointCloud2`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointCloud2 {
    /// Time and frame.
    pub header: Header,
    /// Number of rows; 1 for a cloud that is not organised.
    pub height: u32,
    /// Points per row.
    pub width: u32,
    /// Fields of a point.
    pub fields: Vec<PointField>,
    /// Byte order of the points, whatever that of the message.
    pub is_bigendian: bool,
    /// Length of a point, bytes.
    pub point_step: u32,
    /// Length of a row, bytes.
    pub row_step: u32,
    /// Bytes of the points.
    pub data: Vec<u8>,
    /// Whether all points are finite.
    pub is_dense: bool,
}

/// `PointField::FLOAT32` and `FLOAT64`.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Why a message's points cannot be read.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum PointCloudError {
    /// A coordinate is missing.
    #[error("the cloud has no field {0:?}: its fields are {1}")]
    NoField(&'static str, String),
    /// A coordinate is not a floating-point number.
    #[error("field {name:?} of the cloud has datatype {datatype}: give FLOAT32 (7) or FLOAT64 (8)")]
    Datatype {
        /// The field.
        name: String,
        /// Its datatype in the message.
        datatype: u8,
    },
    /// A coordinate reaches beyond its point.
    #[error("field {name:?} of the cloud ends {end} bytes into a point of {point_step}")]
    Offset {
        /// The field.
        name: String,
        /// Offset of its end, bytes.
        end: u64,
        /// Length of a point.
        point_step: u32,
    },
    /// The points of a row are longer than the row.
    #[error("{width} points of {point_step} bytes are longer than the cloud's row of {row_step}")]
    Row {
        /// Points per row.
        width: u32,
        /// Length of a point.
        point_step: u32,
        /// Length of a row.
        row_step: u32,
    },
    /// The data is too short for the points.
    #[error("the cloud says {says} bytes and has {has}")]
    Length {
        /// Bytes that rows and points need.
        says: u64,
        /// Bytes of data.
        has: usize,
    },
}

/// A coordinate's offset in a point, and its type.
struct Coordinate {
    at: usize,
    is_double: bool,
}

impl Coordinate {
    fn of(cloud: &PointCloud2, name: &'static str) -> Result<Coordinate, PointCloudError> {
        let field = cloud.fields.iter().find(|field| field.name == name);
        let Some(PointField {
            offset, datatype, ..
        }) = field
        else {
            let names: Vec<_> = cloud.fields.iter().map(|f| f.name.as_str()).collect();
            return Err(PointCloudError::NoField(name, names.join(", ")));
        };
        let length = match *datatype {
            FLOAT32 => 4,
            FLOAT64 => 8,
            datatype => {
                let name = name.into();
                return Err(PointCloudError::Datatype { name, datatype });
            }
        };
        let end = u64::from(*offset) + length;
        if end > cloud.point_step.into() {
            return Err(PointCloudError::Offset {
                name: name.into(),
                end,
                point_step: cloud.point_step,
            });
        }
        Ok(Coordinate {
            at: *offset as usize,
            is_double: length == 8,
        })
    }

    fn read(&self, point: &[u8], is_bigendian: bool) -> f64 {
        let bytes = &point[self.at..];
        if self.is_double {
            let bytes = *bytes.first_chunk().expect("checked to lie in the point");
            let [big, little] = [f64::from_be_bytes(bytes), f64::from_le_bytes(bytes)];
            if is_bigendian { big } else { little }
        } else {
            let bytes = *bytes.first_chunk().expect("checked to lie in the point");
            let [big, little] = [f32::from_be_bytes(bytes), f32::from_le_bytes(bytes)];
            f64::from(if is_bigendian { big } else { little })
        }
    }
}

impl PointCloud2 {
    /// A message with these points in this frame.
    pub fn of(points: impl Iterator<Item = Point>, frame: String) -> PointCloud2 {
        let data: Vec<u8> = points.flatten().flat_map(f32::to_le_bytes).collect();
        let field = |(name, offset): (&str, u32)| PointField {
            name: name.into(),
            offset,
            datatype: FLOAT32,
            count: 1,
        };
        let point_step = 12;
        PointCloud2 {
            header: Header {
                frame_id: frame,
                ..Header::default()
            },
            height: 1,
            width: data.len() as u32 / point_step,
            fields: [("x", 0), ("y", 4), ("z", 8)].map(field).into(),
            is_bigendian: false,
            point_step,
            row_step: data.len() as u32,
            data,
            is_dense: true,
        }
    }

    /// All points, row by row. An organised cloud has points that are not finite where its sensor saw nothing.
    ///
    /// # Errors
    /// Coordinates that are missing, of other types or reach beyond a point, and too few bytes for the rows and points.
    pub fn positions(&self) -> Result<Vec<Position>, PointCloudError> {
        let [x, y, z] = ["x", "y", "z"].map(|name| Coordinate::of(self, name));
        let coordinates = [x?, y?, z?];
        let PointCloud2 {
            height,
            width,
            point_step,
            row_step,
            ref data,
            ..
        } = *self;
        let row = u64::from(width) * u64::from(point_step);
        if row == 0 {
            return Ok(Vec::new());
        }
        // A single row needs no row step, and some drivers give none.
        let step = if height <= 1 {
            row.max(row_step.into())
        } else {
            row_step.into()
        };
        if row > step {
            return Err(PointCloudError::Row {
                width,
                point_step,
                row_step,
            });
        }
        // The last row may end with its last point.
        let says = (u64::from(height).saturating_sub(1))
            .checked_mul(step)
            .and_then(|before| before.checked_add(if height == 0 { 0 } else { row }));
        let says = says.unwrap_or(u64::MAX);
        if says > data.len() as u64 {
            let has = data.len();
            return Err(PointCloudError::Length { says, has });
        }
        let mut positions = Vec::new();
        for index in 0..height as usize {
            let row = &data[index * step as usize..][..row as usize];
            let read = |point: &[u8]| {
                coordinates
                    .each_ref()
                    .map(|coordinate| coordinate.read(point, self.is_bigendian))
            };
            positions.extend(row.chunks_exact(point_step as usize).map(read));
        }
        Ok(positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [Position; 4] = [
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
        [f64::NAN, 0.0, 0.0],
        [7.0, 8.0, 9.0],
    ];

    /// Two rows of two points: fields in any order, either width and byte order, gaps in points and after rows.
    fn cloud(
        order: [usize; 3],
        is_double: bool,
        is_bigendian: bool,
        gap: usize,
        pad: usize,
    ) -> PointCloud2 {
        let length = if is_double { 8 } else { 4 };
        let point_step = gap + 3 * length + gap;
        let row_step = 2 * point_step + pad;
        let names = ["x", "y", "z"];
        let mut fields = vec![PointField {
            name: "rgb".into(),
            offset: 0,
            datatype: 6,
            count: 1,
        }];
        let mut data = vec![0xff; 2 * row_step];
        for (place, &axis) in order.iter().enumerate() {
            let offset = gap + place * length;
            fields.push(PointField {
                name: names[axis].into(),
                offset: offset as u32,
                datatype: if is_double { FLOAT64 } else { FLOAT32 },
                count: 1,
            });
            for (index, point) in POINTS.iter().enumerate() {
                let at = index / 2 * row_step + index % 2 * point_step + offset;
                let value = point[axis];
                let bytes = match (is_double, is_bigendian) {
                    (true, true) => value.to_be_bytes().to_vec(),
                    (true, false) => value.to_le_bytes().to_vec(),
                    (false, true) => (value as f32).to_be_bytes().to_vec(),
                    (false, false) => (value as f32).to_le_bytes().to_vec(),
                };
                data[at..at + length].copy_from_slice(&bytes);
            }
        }
        PointCloud2 {
            height: 2,
            width: 2,
            fields,
            is_bigendian,
            point_step: point_step as u32,
            row_step: row_step as u32,
            data,
            ..PointCloud2::default()
        }
    }

    /// The points that are finite.
    fn points(cloud: &PointCloud2) -> Result<Vec<Position>, PointCloudError> {
        let mut points = cloud.positions()?;
        points.retain(|point| point.iter().all(|x| x.is_finite()));
        Ok(points)
    }

    #[test]
    fn every_layout_gives_the_points() {
        let expected = vec![POINTS[0], POINTS[1], POINTS[3]];
        for order in [[0, 1, 2], [2, 0, 1], [1, 2, 0]] {
            for is_double in [false, true] {
                for is_bigendian in [false, true] {
                    for (gap, pad) in [(0, 0), (3, 0), (4, 5)] {
                        let cloud = cloud(order, is_double, is_bigendian, gap, pad);
                        assert_eq!(points(&cloud), Ok(expected.clone()));
                    }
                }
            }
        }
        // The last row ends with its points.
        let mut short = cloud([0, 1, 2], false, false, 0, 8);
        short.data.truncate(short.data.len() - 8);
        assert_eq!(points(&short), Ok(expected));
        short.data.pop();
        let (says, has) = (short.data.len() as u64 + 1, short.data.len());
        assert_eq!(points(&short), Err(PointCloudError::Length { says, has }));
    }

    #[test]
    fn what_is_wrong_with_a_cloud_is_said() {
        let good = || cloud([0, 1, 2], false, false, 0, 0);
        assert_eq!(
            points(&PointCloud2 {
                height: 0,
                ..good()
            }),
            Ok(vec![])
        );
        // As many rows as possible, without points.
        let empty = PointCloud2 {
            height: u32::MAX,
            width: 0,
            row_step: 0,
            ..good()
        };
        assert_eq!(points(&empty), Ok(vec![]));
        let mut flat = good();
        flat.fields.retain(|field| field.name != "z");
        let error = points(&flat).expect_err("no z").to_string();
        assert!(
            error.contains("\"z\"") && error.contains("rgb, x, y"),
            "{error}"
        );
        let mut coded = good();
        coded.fields[1].datatype = 3;
        assert!(matches!(
            points(&coded),
            Err(PointCloudError::Datatype { datatype: 3, .. })
        ));
        let mut outside = good();
        outside.fields[3].offset = u32::MAX;
        assert!(matches!(
            points(&outside),
            Err(PointCloudError::Offset { .. })
        ));
        let narrow = PointCloud2 {
            row_step: 3,
            ..good()
        };
        assert!(matches!(points(&narrow), Err(PointCloudError::Row { .. })));
        let endless = PointCloud2 {
            height: u32::MAX,
            row_step: u32::MAX,
            ..good()
        };
        assert!(matches!(
            points(&endless),
            Err(PointCloudError::Length { .. })
        ));
        let single = PointCloud2 {
            height: 1,
            width: 4,
            row_step: 0,
            ..good()
        };
        assert_eq!(points(&single).map(|points| points.len()), Ok(3));
    }
}
