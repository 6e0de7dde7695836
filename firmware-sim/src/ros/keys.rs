//! Names on the network, as in `rmw_zenoh`: key expressions of topics and services; liveliness tokens of nodes, publishers,
//! subscriptions and services; and the identities that follow from the tokens.
//!
//! Source: `rmw_zenoh_cpp` of ROS 2 Jazzy and later, `docs/design.md` and `src/detail/liveliness_utils.cpp`.

use twox_hash::XxHash3_128;

/// The type of a message or service, as both ends agree on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Type {
    /// Its DDS name.
    pub(crate) name: &'static str,
    /// SHA-256 of its definition (REP 2016).
    pub(crate) hash: &'static str,
}

pub(crate) const POINT_CLOUD: Type = Type {
    name: "sensor_msgs::msg::dds_::PointCloud2_",
    hash: "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
};
pub(crate) const POSE: Type = Type {
    name: "geometry_msgs::msg::dds_::PoseStamped_",
    hash: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
};
pub(crate) const POSE_WITH_COVARIANCE: Type = Type {
    name: "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
    hash: "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
};
pub(crate) const DIAGNOSTICS: Type = Type {
    name: "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    hash: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
};
pub(crate) const TRANSFORMS: Type = Type {
    name: "tf2_msgs::msg::dds_::TFMessage_",
    hash: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
};

pub(crate) const TRIGGER: Type = Type {
    name: "std_srvs::srv::dds_::Trigger_",
    hash: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
};

pub(crate) const DESCRIBE_PARAMETERS: Type = Type {
    name: "rcl_interfaces::srv::dds_::DescribeParameters_",
    hash: "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
};
pub(crate) const GET_PARAMETER_TYPES: Type = Type {
    name: "rcl_interfaces::srv::dds_::GetParameterTypes_",
    hash: "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
};
pub(crate) const GET_PARAMETERS: Type = Type {
    name: "rcl_interfaces::srv::dds_::GetParameters_",
    hash: "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
};
pub(crate) const LIST_PARAMETERS: Type = Type {
    name: "rcl_interfaces::srv::dds_::ListParameters_",
    hash: "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
};
pub(crate) const SET_PARAMETERS: Type = Type {
    name: "rcl_interfaces::srv::dds_::SetParameters_",
    hash: "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
};
pub(crate) const SET_PARAMETERS_ATOMICALLY: Type = Type {
    name: "rcl_interfaces::srv::dds_::SetParametersAtomically_",
    hash: "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
};
pub(crate) const PARAMETER_EVENT: Type = Type {
    name: "rcl_interfaces::msg::dds_::ParameterEvent_",
    hash: "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
};

/// Quality of service, as far as it differs from `rmw_zenoh`'s default: reliable, volatile, the last 42.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Qos {
    /// Reliable, the last ten: publishers and services.
    Reliable,
    /// Best effort, the last five: sensors.
    Sensor,
    /// Reliable, the last hundred: transforms.
    Transforms,
    /// Reliable, the last thousand: services and events of parameters.
    Parameters,
    /// Reliable, the last one, also for later subscribers (transient local).
    Latched,
}

impl Qos {
    /// `<reliability>:<durability>:<history>,<depth>:<deadline>:<lifespan>:<liveliness>`.
    fn chunk(self) -> &'static str {
        match self {
            Qos::Reliable => "::,10:,:,:,,",
            Qos::Sensor => "2::,5:,:,:,,",
            Qos::Transforms => "::,100:,:,:,,",
            Qos::Parameters => "::,1000:,:,:,,",
            Qos::Latched => ":1:,1:,:,:,,",
        }
    }
}

/// A node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) domain: u8,
    /// The session's identity, as Zenoh shows it.
    pub(crate) zid: String,
    /// Absolute, such as `/` or `/arm`.
    pub(crate) namespace: String,
    pub(crate) name: String,
}

/// What a node can declare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Publisher,
    Subscription,
    Service,
}

/// The node's own number within its session.
const NODE_ID: u32 = 0;

/// Replaces slashes, which would begin another chunk of a key.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

impl Node {
    /// The node's absolute name.
    pub(crate) fn full_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }

    /// The absolute name of a topic or service of the node's own.
    pub(crate) fn own_topic(&self, topic: &str) -> String {
        format!("{}/{topic}", self.full_name())
    }

    /// The key on which a topic's messages are published, or a service's requests sent.
    pub(crate) fn topic_key(&self, topic: &str, of: Type) -> String {
        let topic = topic.trim_matches('/');
        format!("{}/{topic}/{}/{}", self.domain, of.name, of.hash)
    }

    fn token_of(&self, id: u32, kind: &str) -> String {
        format!(
            "@ros2_lv/{}/{}/{NODE_ID}/{id}/{kind}/%/{}/{}",
            self.domain,
            self.zid,
            mangled(&self.namespace),
            self.name
        )
    }

    /// The node's liveliness token.
    pub(crate) fn token(&self) -> String {
        self.token_of(NODE_ID, "NN")
    }

    /// The liveliness token of its publisher, subscription or service number `id`, from 1.
    pub(crate) fn endpoint_token(
        &self,
        id: u32,
        kind: Kind,
        (topic, of, qos): (&str, Type, Qos),
    ) -> String {
        let kind = match kind {
            Kind::Publisher => "MP",
            Kind::Subscription => "MS",
            Kind::Service => "SS",
        };
        let (token, topic) = (self.token_of(id, kind), mangled(topic));
        format!("{token}/{topic}/{}/{}/{}", of.name, of.hash, qos.chunk())
    }
}

/// The identity of a publisher, subscription or client.
pub(crate) type Gid = [u8; 16];

/// The identity: XXH3-128 of the token, low half first.
pub(crate) fn gid(token: &str) -> Gid {
    XxHash3_128::oneshot(token.as_bytes()).to_le_bytes()
}

/// The attachment of every message: its number from 1, its time, and its sender, as `zenoh-ext` serialises them.
pub(crate) fn attachment(sequence: i64, unix_ns: i64, gid: Gid) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(33);
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(unix_ns.to_le_bytes());
    bytes.push(16);
    bytes.extend(gid);
    bytes
}

/// The number and the sender in such an attachment.
pub(crate) fn sender_of(attachment: &[u8]) -> Option<(i64, Gid)> {
    let (sequence, rest) = attachment.split_first_chunk()?;
    let (_unix_ns, rest) = rest.split_first_chunk::<8>()?;
    let gid = rest.strip_prefix(&[16])?.try_into().ok()?;
    Some((i64::from_le_bytes(*sequence), gid))
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRING: Type = Type {
        name: "std_msgs::msg::dds_::String_",
        hash: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    };

    fn talker(namespace: &str) -> Node {
        Node {
            domain: 0,
            zid: "8b20917502ee955ac4476e0266340d5c".into(),
            namespace: namespace.into(),
            name: "talker".into(),
        }
    }

    /// The keys that `docs/design.md` of `rmw_zenoh` shows.
    #[test]
    fn keys_and_tokens_are_those_of_the_design_document() {
        let node = talker("/");
        let zid = &node.zid;
        assert_eq!(node.token(), format!("@ros2_lv/0/{zid}/0/0/NN/%/%/talker"));
        let key = node.topic_key("/chatter", STRING);
        assert_eq!(key, format!("0/chatter/{}/{}", STRING.name, STRING.hash));
        let token = node.endpoint_token(10, Kind::Publisher, ("/chatter", STRING, Qos::Reliable));
        let shown = format!(
            "@ros2_lv/0/{zid}/0/10/MP/%/%/talker/%chatter/{}/{}/::,10:,:,:,,",
            STRING.name, STRING.hash
        );
        assert_eq!(token, shown);
    }

    #[test]
    fn namespaces_are_one_chunk_of_a_token_and_several_of_a_key() {
        let node = talker("/lab/arm");
        assert!(node.token().ends_with("/NN/%/%lab%arm/talker"));
        let topic = node.own_topic("pose");
        assert_eq!(topic, "/lab/arm/talker/pose");
        assert!(
            node.topic_key(&topic, POSE)
                .starts_with("0/lab/arm/talker/pose/geometry_msgs::")
        );
        assert_eq!(talker("/").own_topic("pose"), "/talker/pose");
    }

    /// The hash of nothing, from xxHash's own test vectors.
    #[test]
    fn the_identity_is_the_hash_with_its_low_half_first() {
        let expected = 0x99aa_06d3_0147_98d8_6001_c324_468d_497f_u128;
        assert_eq!(gid(""), expected.to_le_bytes());
        let bytes = attachment(1, -2, gid(""));
        assert_eq!(
            bytes[..17],
            [
                1, 0, 0, 0, 0, 0, 0, 0, 0xfe, 255, 255, 255, 255, 255, 255, 255, 16
            ]
        );
        assert_eq!(bytes[17..], gid(""));
        assert_eq!(sender_of(&bytes), Some((1, gid(""))));
        assert!((0..33).all(|end| sender_of(&bytes[..end]).is_none()));
        assert_eq!(sender_of(&[bytes, vec![0]].concat()), None);
    }
}
