//! Tags of the family tag36h11: a black border of one cell around 6 x 6 bits.

/// Number of cells along the side of a tag, with its border.
pub const CELLS: u32 = 8;
/// Number of known tags: the first ones of the family.
pub const TAGS: u32 = CODES.len() as u32;
/// Number of data bits along a side.
const BITS: u32 = CELLS - 2;
/// Maximum number of wrong bits that are corrected. Codes have a Hamming distance of at least 11, so five could be
/// corrected, but with more false detections.
const MOST_WRONG: u32 = 2;

/// First codes of the family: bits in row-major order from the top left, the first one most significant; 1 is white.
///
/// Table of the AprilTag project, copyright 2013-2016 The Regents of The University of Michigan, BSD 2-Clause.
const CODES: [u64; 64] = [
    0xd_5d62_8584,
    0xd_97f1_8b49,
    0xd_d280_910e,
    0xe_479e_9c98,
    0xe_bcbc_a822,
    0xf_31da_b3ac,
    0x0_56a5_d085,
    0x1_0652_e1d4,
    0x2_2b1d_fead,
    0x2_65ad_0472,
    0x3_4fe9_1b86,
    0x3_ff96_2cd5,
    0x4_3a25_329a,
    0x4_74b4_385f,
    0x4_e9d2_43e9,
    0x5_2461_49ae,
    0x5_997f_5538,
    0x6_83bb_6c4c,
    0x6_be4a_7211,
    0x7_e315_8eea,
    0x8_1da4_94af,
    0x8_5833_9a74,
    0x8_cd51_a5fe,
    0x9_f21c_c2d7,
    0xa_2cab_c89c,
    0xa_dc58_d9eb,
    0xb_16e7_dfb0,
    0xb_8c05_eb3a,
    0xd_25ef_139d,
    0xd_607e_1962,
    0xe_4aba_3076,
    0x2_dde6_a3da,
    0x4_3d40_c678,
    0x5_620b_e351,
    0x6_4c47_fa65,
    0x6_86d7_002a,
    0x6_c166_05ef,
    0x6_fbf5_0bb4,
    0x8_d06d_39dc,
    0x9_f538_56b5,
    0xa_df74_6dc9,
    0xb_c9b0_84dd,
    0xd_290a_a77b,
    0xd_9e28_b305,
    0xe_4dd5_c454,
    0xf_ad2f_e6f2,
    0x1_81a8_151a,
    0x2_6be4_2c2e,
    0x2_e102_37b8,
    0x4_05cd_5491,
    0x7_742e_ab1c,
    0x8_5e6a_c230,
    0x8_d388_cdba,
    0x9_f853_ea93,
    0xc_41ea_2445,
    0xc_f197_3594,
    0x1_4a34_a333,
    0x3_1eac_d15b,
    0x6_c79d_2dab,
    0x7_3cbb_3935,
    0x8_9c15_5bd3,
    0x8_d6a4_6198,
    0x9_1133_675d,
    0xa_708d_89fb,
];

/// True for a black cell of a known tag; column and row are counted from the top left, border included.
pub fn is_dark(id: u32, column: u32, row: u32) -> bool {
    let is_border = [column, row].iter().any(|&at| at == 0 || at == CELLS - 1);
    is_border || CODES[id as usize] >> (BITS * BITS - 1 - (row - 1) * BITS - (column - 1)) & 1 == 0
}

/// Tag whose bits were read in row-major order from any of its corners: its id, and how many corners clockwise from the
/// first one its top left is. `None` if no code is close enough.
pub fn decoded(bits: u64) -> Option<(u32, usize)> {
    let turns = std::iter::successors(Some(bits), |&bits| Some(turned(bits))).take(4).enumerate();
    let near = turns
        .flat_map(|(turn, bits)| (0..TAGS).zip(CODES).map(move |(id, code)| ((bits ^ code).count_ones(), id, turn)));
    near.min().filter(|(wrong, ..)| *wrong <= MOST_WRONG).map(|(_, id, turn)| (id, turn))
}

/// The same bits read from the next corner clockwise.
fn turned(bits: u64) -> u64 {
    let bit = |row: u32, column: u32| bits >> (BITS * BITS - 1 - row * BITS - column) & 1;
    let cells = (0..BITS).flat_map(|row| (0..BITS).map(move |column| (row, column)));
    cells.fold(0, |code, (row, column)| code << 1 | bit(column, BITS - 1 - row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_differ_in_eleven_bits_in_every_rotation() {
        for (id, code) in CODES.into_iter().enumerate() {
            let mut bits = code;
            for turn in 0..4 {
                for (other, its) in CODES.into_iter().enumerate().filter(|(other, _)| turn > 0 || *other != id) {
                    assert!((bits ^ its).count_ones() >= 11, "{id} turned {turn} times and {other}");
                }
                // Read one corner later in each round, so the tag begins as many corners earlier.
                assert_eq!(decoded(bits ^ 0x8_0000_0001), Some((id as u32, (4 - turn) % 4)));
                bits = turned(bits);
            }
            assert_eq!((bits, decoded(bits ^ 0x111)), (code, None));
        }
    }
}
