//! Numbers in sentences.

/// A number with the right form of what is counted: "1 pose", "2 poses".
pub fn count(number: usize, one: &str, several: &str) -> String {
    match number {
        1 => format!("1 {one}"),
        _ => format!("{number} {several}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_one_and_none_is_several() {
        let poses = [0, 1, 2].map(|number| count(number, "pose", "poses"));
        assert_eq!(poses, ["0 poses", "1 pose", "2 poses"]);
    }
}
