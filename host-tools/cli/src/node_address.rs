//! How people write nodes' short addresses.

/// As it is shown.
pub(crate) fn hex(address: u16) -> String {
    format!("0x{address:04X}")
}

/// An address as it is given: 0x and hexadecimal digits, or decimal.
///
/// # Errors
/// Says what is expected.
pub(crate) fn parse(text: &str) -> Result<u16, String> {
    let text = text.trim();
    let number = match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| format!("'{text}' is no node's address; they look like 0x0A1B, or 2587"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shown_can_be_given_and_bare_hexadecimal_is_not_guessed() {
        for address in [0, 1, 0x0A1B, u16::MAX] {
            assert_eq!(parse(&hex(address)), Ok(address));
            assert_eq!(parse(&address.to_string()), Ok(address));
        }
        for text in ["0A1B", "", "-1", "65536", "0x10000", "0x"] {
            assert!(parse(text).unwrap_err().contains("0x0A1B"), "{text}");
        }
    }
}
