//! Every reason for a refusal, as one flat `Copy` enum.

use core::fmt;

/// Why a call was refused. Unless its documentation says otherwise, the refused call changed nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The cloud has no points.
    EmptyCloud,
    /// The cloud has fewer points than fix a rigid transform.
    TooFewPoints {
        /// Points given.
        points: usize,
    },
    /// The cloud has more points than the capacity.
    TooManyPoints {
        /// Points given.
        points: usize,
        /// Points that fit.
        capacity: usize,
    },
    /// A coordinate is NaN or infinite.
    NotFinite {
        /// Index of the first such point.
        index: usize,
    },
    /// A coordinate is beyond [`crate::cloud::LARGEST_COORDINATE`]: a marker for "not measured", not a measurement.
    OutOfRange {
        /// Index of the first such point.
        index: usize,
    },
    /// All points of a cloud coincide: there is no scale to normalise by, and nothing to align.
    NoExtent,
    /// The target's points span less than 1e-12: squared distances underflow.
    TooSmall,
    /// A pose holds a NaN, an infinity or a matrix that is not a rotation.
    BadPose,
    /// A frame's centre or scale is not finite or too large, or its scale below 1e-12.
    BadFrame,
    /// A coordinate of the view point is NaN, infinite or beyond [`crate::cloud::LARGEST_COORDINATE`].
    BadViewPoint,
    /// A standard deviation of the start is negative or NaN.
    BadUncertainty,
    /// The registration was not started, or was started with another policy.
    NotStarted,
    /// The weight file ends early, or bytes follow its end.
    WeightsLength {
        /// Bytes that the header announces.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// The bytes do not begin with the magic of a weight file.
    WeightsMagic,
    /// The weight file has a format version that this build does not read.
    WeightsVersion {
        /// Version in the file.
        found: u16,
        /// Version that this build reads.
        expected: u16,
    },
    /// The weight file uses a number format that this build does not read.
    WeightsFormat {
        /// Number format in the file.
        found: u16,
    },
    /// The weight file asks for a way to decide that this build does not know ([`crate::Decision`]).
    WeightsDecision {
        /// Decision in the file.
        found: u16,
    },
    /// A layer's shape or offset in the file is not what this build expects.
    WeightsShape {
        /// Index in the layer table.
        layer: usize,
    },
    /// The weight file's checksum does not match: its bytes have changed.
    WeightsCrc,
    /// The weight bytes do not start on a 4-byte boundary.
    WeightsAlignment,
    /// A weight is NaN or infinite.
    WeightsNotFinite {
        /// Index in the layer table.
        layer: usize,
    },
    /// Sums of an integer layer could overflow, or a requantisation factor is unusable.
    WeightsRange {
        /// Index in the layer table.
        layer: usize,
    },
    /// A frame ends early or cannot be decoded.
    Frame,
    /// A frame has a version that this build does not speak.
    FrameVersion {
        /// Version in the frame.
        found: u8,
        /// Version that this build speaks.
        expected: u8,
    },
    /// A frame does not fit the buffer it is written to.
    FrameBuffer,
    /// A fleet or robot name is empty, too long, or has characters other than `a-z A-Z 0-9 _ -`.
    Name,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use Error::*;
        match *self {
            EmptyCloud => write!(f, "the cloud is empty; give at least 3 points"),
            TooFewPoints { points } => {
                let s = if points == 1 { "" } else { "s" };
                write!(f, "the cloud has {points} point{s}; give at least 3")
            }
            TooManyPoints { points, capacity } => write!(
                f,
                "the cloud has {points} points and {capacity} fit; subsample it"
            ),
            NotFinite { index } => write!(
                f,
                "point {index} has a NaN or infinite coordinate; drop invalid points first"
            ),
            OutOfRange { index } => write!(
                f,
                "point {index} has a coordinate beyond 1e12, which marks what was not measured; drop such points first"
            ),
            NoExtent => write!(
                f,
                "all points of the cloud coincide; there is nothing to align"
            ),
            TooSmall => write!(
                f,
                "the target spans less than 1e-12; give both clouds in a smaller unit of length"
            ),
            BadPose => write!(
                f,
                "the pose is not a rigid transform, or its translation is beyond 1e12; give a rotation without scale, and a translation in the clouds' unit"
            ),
            BadFrame => write!(
                f,
                "the frame's centre must be finite and within 1e12, its scale 1e-12 to 1e13"
            ),
            BadViewPoint => write!(
                f,
                "the view point has a coordinate that is NaN, infinite or beyond 1e12; give the sensor's place in the source's frame, or none"
            ),
            BadUncertainty => write!(
                f,
                "a standard deviation of the start is negative or NaN; give 0 or more"
            ),
            NotStarted => write!(
                f,
                "the registration was not started with this policy; start it first"
            ),
            WeightsLength { expected, found } => write!(
                f,
                "weight file of {found} bytes where {expected} were expected; fetch it again"
            ),
            WeightsMagic => write!(f, "not a weight file (.rgw); its first bytes are wrong"),
            WeightsVersion { found, expected } => write!(
                f,
                "weight file version {found}, this build reads {expected}; export it again"
            ),
            WeightsFormat { found } => {
                write!(
                    f,
                    "weight number format {found} is not known to this build; export it again, or update the program"
                )
            }
            WeightsDecision { found } => {
                write!(
                    f,
                    "weight file decides in way {found}, which this build does not know; export it again, or update the program"
                )
            }
            WeightsShape { layer } => write!(
                f,
                "layer {layer} of the weight file has another shape or place than this build's; export it again"
            ),
            WeightsCrc => write!(f, "weight file is corrupt (CRC-32 differs); fetch it again"),
            WeightsAlignment => write!(
                f,
                "weight bytes must start on a 4-byte boundary; align the array, or copy it"
            ),
            WeightsNotFinite { layer } => {
                write!(
                    f,
                    "layer {layer} of the weight file holds a NaN or infinity; export a policy whose weights are finite"
                )
            }
            WeightsRange { layer } => write!(
                f,
                "sums of layer {layer} of the weight file could overflow 32 bits, or a factor is not usable; export it again"
            ),
            Frame => write!(f, "the frame is cut or malformed; send it again"),
            FrameVersion { found, expected } => {
                write!(
                    f,
                    "frame version {found}, this build speaks {expected}; update the older side"
                )
            }
            FrameBuffer => write!(f, "frame does not fit the buffer; give a longer one"),
            Name => write!(
                f,
                "fleet and robot names are 1 to 32 characters of a-z A-Z 0-9 _ -"
            ),
        }
    }
}

impl core::error::Error for Error {}
