use super::*;

#[test]
fn settings_out_of_range_are_refused() {
    let usual = PhotonSettings::default();
    let wrong = [
        PhotonSettings { count: 0, ..usual },
        PhotonSettings { count: (1 << 24) + 1, ..usual },
        PhotonSettings { nearest: 0, ..usual },
        PhotonSettings { nearest: (1 << 16) + 1, ..usual },
        PhotonSettings { path_length: Some(0), ..usual },
    ];
    assert!(usual.check().is_ok() && PhotonSettings { path_length: Some(3), ..usual }.check().is_ok());
    for settings in wrong {
        assert!(settings.check().is_err_and(|error| error.is_bad_input()), "{settings:?}");
    }
}
