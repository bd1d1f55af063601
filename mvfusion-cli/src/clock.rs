//! Times of day for the record of a run.

use jiff::Timestamp;

/// Now, in UTC, as RFC 3339 (ISO 8601): `2026-03-09T17:04:05Z`.
pub fn now() -> String {
    whole_seconds(Timestamp::now())
}

/// A time without fractions of a second.
fn whole_seconds(time: Timestamp) -> String {
    time.strftime("%Y-%m-%dT%H:%M:%SZ").to_string()
}

/// A duration for people: `48 s`, `3 min 05 s`, `2 h 10 min`.
pub fn spoken(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_written_in_utc_without_fractions() {
        let written = |text: &str| whole_seconds(text.parse().expect("a time"));
        assert_eq!(written("1970-01-01T00:00:00Z"), "1970-01-01T00:00:00Z");
        assert_eq!(written("2000-02-29T01:59:59.9+02:00"), "2000-02-28T23:59:59Z");
        let now = now();
        assert!(now.len() == 20 && now.starts_with("20"), "{now}");
    }

    #[test]
    fn durations_are_said_as_people_say_them() {
        assert_eq!(spoken(47.6), "48 s");
        assert_eq!(spoken(185.0), "3 min 05 s");
        assert_eq!(spoken(7800.0), "2 h 10 min");
    }
}
