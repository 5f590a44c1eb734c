//! The header, generated from the code by cbindgen.

use std::fs;
use std::path::Path;

use cbindgen::{Builder, Config, ExportConfig, Language, RenameRule, Style};

const ABOUT: &str = "/* The C interface of phasestereo: dense stereo matching that stands blur. Made by cbindgen; see docs/c.md.
 *
 *     phasestereo_matcher *matcher = phasestereo_new(\"robust\", NULL, 0, 0);
 *     if (phasestereo_match(matcher, &left, &right, 0, 64, &map, NULL) != PHASESTEREO_STATUS_OK) puts(phasestereo_error());
 *     phasestereo_free(matcher);
 */";

fn header() -> String {
    let renamed = |name: &str| (name.to_owned(), format!("phasestereo_{}", name.to_lowercase()));
    let names = ["Matcher", "Setting", "Status", "Image", "Map", "Blur", "Found"];
    let mut config = Config {
        language: Language::C,
        header: Some(ABOUT.into()),
        no_includes: true,
        sys_includes: ["stddef.h", "stdint.h"].map(Into::into).into(),
        include_guard: Some("PHASESTEREO_H".into()),
        cpp_compat: true,
        usize_is_size_t: true,
        style: Style::Both,
        line_length: 120,
        documentation_length: cbindgen::DocumentationLength::Full,
        export: ExportConfig {
            rename: names.map(renamed).into_iter().collect(),
            ..Default::default()
        },
        ..Config::default()
    };
    config.enumeration.rename_variants = RenameRule::QualifiedScreamingSnakeCase;

    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust");
    let sources = ["c/found.rs", "c/images.rs", "c.rs"].map(|name| folder.join(name));
    let builder = sources.into_iter().fold(Builder::new().with_config(config), Builder::with_src);
    let mut header = vec![];
    builder.generate().expect("the interface is one of C").write(&mut header);
    // Rust's section title has no meaning in C.
    String::from_utf8(header).expect("text").replace(" * # Safety\n *\n", "")
}

/// A header that differs from the code is rewritten, so that it can be committed.
#[test]
fn the_header_is_that_of_the_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/c/phasestereo.h");
    let (made, kept) = (header(), fs::read_to_string(&path).unwrap_or_default());

    if made != kept {
        fs::write(&path, &made).expect("the header can be written");
    }
    assert!(made == kept, "{} was not that of the code, and is now: commit it", path.display());
}
