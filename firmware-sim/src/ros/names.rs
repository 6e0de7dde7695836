//! ROS names on the command line. A bad name is refused with what is wrong and what is allowed.
//!
//! Source: `rmw/validate_full_topic_name.h` and its neighbours.

/// Longest name of a topic, `RMW_TOPIC_MAX_NAME_LENGTH`.
pub(super) const TOPIC_BYTES: usize = 247;
/// The rule for names, as error messages give it.
const RULE: &str = "with names of letters, digits and single underscores that begin with no digit";

/// An absolute topic.
pub(super) fn topic(text: &str) -> Result<String, String> {
    let wrong = match text {
        "/" => Err("it has no name".into()),
        _ => absolute(text).and_then(|()| short(text)),
    };
    wrong.map_err(|wrong| format!("{wrong}; a topic is /NAME or /NAME/NAME and so on, {RULE}"))?;
    Ok(text.into())
}

/// A namespace, or the root.
pub(super) fn namespace(text: &str) -> Result<String, String> {
    let wrong = match text {
        "/" => Ok(()),
        _ => absolute(text),
    };
    wrong.map_err(|wrong| format!("{wrong}; a namespace is / alone or as /NAME/NAME, {RULE}"))?;
    Ok(text.into())
}

/// A node's own name.
pub(super) fn node(text: &str) -> Result<String, String> {
    word(text).map_err(|wrong| format!("{wrong}; a node has one name, {RULE}"))?;
    Ok(text.into())
}

/// A frame, as `tf2` takes it.
pub(super) fn frame(text: &str) -> Result<String, String> {
    let wrong = if text.is_empty() {
        "it is empty"
    } else if text.starts_with('/') {
        "it begins with a slash"
    } else if text.contains(|c: char| c.is_whitespace() || c.is_control()) {
        "it has a space"
    } else {
        return Ok(text.into());
    };
    Err(format!(
        "{wrong}; a frame is a name without spaces that begins with no slash, such as part"
    ))
}

/// A domain, as in ROS_DOMAIN_ID, which counts as 0 where it is empty.
pub(super) fn domain(text: &str) -> Result<u8, String> {
    if text.is_empty() {
        return Ok(0);
    }
    let number = text.parse().ok().filter(|number| *number <= 232);
    number.ok_or_else(|| "a domain is a number from 0 to 232".into())
}

fn absolute(text: &str) -> Result<(), String> {
    let words = text
        .strip_prefix('/')
        .ok_or("it does not begin with a slash")?;
    if words.split('/').any(str::is_empty) {
        return Err("it ends with a slash, or two of them meet".into());
    }
    words.split('/').try_for_each(word)
}

fn word(text: &str) -> Result<(), String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if text.is_empty() {
        Err("it is empty".into())
    } else if let Some(other) = text.chars().find(|&c| !is_plain(c)) {
        Err(format!("it has a {other:?}"))
    } else if text.starts_with(|c: char| c.is_ascii_digit()) {
        Err(format!("{text:?} begins with a digit"))
    } else if text.contains("__") {
        Err(format!("{text:?} has two underscores in a row"))
    } else {
        Ok(())
    }
}

/// Refuses a topic that is too long for ROS.
pub(super) fn short(topic: &str) -> Result<(), String> {
    match topic.len() {
        ..=TOPIC_BYTES => Ok(()),
        bytes => Err(format!(
            "it has {bytes} characters, and a topic at most {TOPIC_BYTES}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_ros_are_taken() {
        let longest = format!("/{}", "a".repeat(TOPIC_BYTES - 1));
        for good in ["/points", "/camera/depth_1/points", &longest] {
            assert_eq!(topic(good).as_deref(), Ok(good));
        }
        for bad in [
            ("", "does not begin with a slash"),
            ("points", "does not begin with a slash"),
            ("~/points", "does not begin with a slash"),
            ("/", "it has no name"),
            ("//", "two of them meet"),
            ("/a/", "it ends with a slash"),
            ("/a//b", "two of them meet"),
            ("/1a", "\"1a\" begins with a digit"),
            ("/a__b", "two underscores"),
            ("/a-b", "it has a '-'"),
            ("/a/**", "it has a '*'"),
            ("/a b", "it has a ' '"),
            ("/ä", "it has a 'ä'"),
            (&format!("{longest}a"), "it has 248 characters"),
        ] {
            let said = topic(bad.0).expect_err(bad.0);
            assert!(
                said.contains(bad.1) && said.contains("; a topic is /NAME"),
                "{said}"
            );
        }
        assert_eq!(namespace("/").as_deref(), Ok("/"));
        assert!(namespace("").is_err() && namespace("lab").is_err() && namespace("/lab/").is_err());
        assert!(node("reagent").is_ok() && node("").is_err() && node("a/b").is_err());
    }

    #[test]
    fn frames_and_domains_are_those_of_the_network() {
        for good in ["part", "arm_1/base-link", "ä"] {
            assert_eq!(frame(good).as_deref(), Ok(good));
        }
        for bad in ["", "/part", "a part", "part\n"] {
            assert!(frame(bad).is_err(), "{bad}");
        }
        let domains = ["", "0", "232"].map(domain);
        assert_eq!(domains, [Ok(0), Ok(0), Ok(232)]);
        assert!(["233", "-1", "x"].iter().all(|bad| domain(bad).is_err()));
    }
}
