//! A short digest of bytes: equal bytes have equal digests, on every platform.

/// The FNV-1a hash of 64 bits (Fowler, Noll & Vo). It detects accidents, not attacks.
#[derive(Debug, Clone, Copy)]
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl Digest {
    /// Adds bytes.
    pub fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    /// The digest of all bytes so far.
    pub fn value(self) -> u64 {
        self.0
    }
}
