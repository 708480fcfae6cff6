//! Numbers in the three byte orders of C3D files.

/// Which machine wrote the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    /// Little-endian, IEEE 754.
    Intel,
    /// Little-endian words, VAX F floating point.
    Dec,
    /// Big-endian, IEEE 754.
    Mips,
}

/// A file in memory. Reading past its end gives `None`.
#[derive(Clone, Copy)]
pub(super) struct Bytes<'a> {
    pub data: &'a [u8],
    pub order: ByteOrder,
}

impl<'a> Bytes<'a> {
    pub fn slice(&self, at: usize, length: usize) -> Option<&'a [u8]> {
        self.data.get(at..at.checked_add(length)?)
    }

    pub fn u8(&self, at: usize) -> Option<u8> {
        self.data.get(at).copied()
    }

    pub fn u16(&self, at: usize) -> Option<u16> {
        let b: [u8; 2] = self.slice(at, 2)?.try_into().ok()?;
        Some(match self.order {
            ByteOrder::Mips => u16::from_be_bytes(b),
            ByteOrder::Intel | ByteOrder::Dec => u16::from_le_bytes(b),
        })
    }

    pub fn i16(&self, at: usize) -> Option<i16> {
        self.u16(at).map(|n| n as i16)
    }

    pub fn f32(&self, at: usize) -> Option<f64> {
        let b: [u8; 4] = self.slice(at, 4)?.try_into().ok()?;
        Some(match self.order {
            ByteOrder::Intel => f32::from_le_bytes(b) as f64,
            ByteOrder::Mips => f32::from_be_bytes(b) as f64,
            ByteOrder::Dec => vax_f(u32::from_le_bytes([b[2], b[3], b[0], b[1]])),
        })
    }
}

/// VAX F: sign, 8 bits of exponent with bias 128, mantissa 0.1fff…; the words are already in order.
/// Exponent 0 is zero, or reserved (not a number) with the sign set. VAX Architecture Reference Manual, ch. 1.
fn vax_f(bits: u32) -> f64 {
    let negative = bits >> 31 == 1;
    let exponent = ((bits >> 23) & 0xff) as i32;
    if exponent == 0 {
        return if negative { f64::NAN } else { 0.0 };
    }
    let mantissa = 1.0 + (bits & 0x7f_ffff) as f64 / (1u32 << 23) as f64;
    let magnitude = mantissa * 2f64.powi(exponent - 129);
    if negative { -magnitude } else { magnitude }
}
