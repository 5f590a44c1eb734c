//! The attribute for functions that are compiled for each instruction-set level, which the formatter and
//! editors read as functions. Its meaning is documented in `phasestereo_match::base::simd`.

use proc_macro::{Delimiter, Group, TokenStream, TokenTree};

/// Passes a function to the macro `by_level` of `phasestereo_match`.
#[proc_macro_attribute]
pub fn leveled(_: TokenStream, function: TokenStream) -> TokenStream {
    let mut call: TokenStream = "::phasestereo_match::by_level!".parse().unwrap_or_default();
    call.extend([TokenTree::from(Group::new(Delimiter::Brace, function))]);
    call
}
