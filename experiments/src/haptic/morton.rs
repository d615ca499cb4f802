//! Grid coordinates and the edge flag of a shell's point in one integer.
//!
//! The bits of the three coordinates alternate (Morton order), so points that are near in space are near in the order; the lowest bit
//! says whether the point lies on a cutting edge. 21 bits a coordinate: grids up to 2 097 152 a side.
//!
//! **Source:** Faieghi et al., II-B; Baert et al. 2013 for the code.

/// Spreads 21 bits to every third.
fn spread(v: u64) -> u64 {
    let steps = [
        (32, 0x001F_0000_0000_FFFF),
        (16, 0x001F_0000_FF00_00FF),
        (8, 0x100F_00F0_0F00_F00F),
        (4, 0x10C3_0C30_C30C_30C3),
        (2, 0x1249_2492_4924_9249),
    ];
    steps.iter().fold(v & 0x1F_FFFF, |v, (shift, mask)| (v | v << shift) & mask)
}

/// Takes every third bit.
fn gather(v: u64) -> u64 {
    let steps = [
        (2, 0x10C3_0C30_C30C_30C3),
        (4, 0x100F_00F0_0F00_F00F),
        (8, 0x001F_0000_FF00_00FF),
        (16, 0x001F_0000_0000_FFFF),
        (32, 0x1F_FFFF),
    ];
    steps.iter().fold(v & 0x1249_2492_4924_9249, |v, (shift, mask)| (v | v >> shift) & mask)
}

/// The code of a point.
pub fn encode([x, y, z]: [u32; 3], on_edge: bool) -> u64 {
    (spread(x.into()) | spread(y.into()) << 1 | spread(z.into()) << 2) << 1 | u64::from(on_edge)
}

/// Coordinates of a code.
#[inline]
pub fn coordinates(code: u64) -> [u32; 3] {
    let code = code >> 1;
    [gather(code) as u32, gather(code >> 1) as u32, gather(code >> 2) as u32]
}

/// Whether the point of a code lies on a cutting edge.
#[inline]
pub fn is_on_edge(code: u64) -> bool {
    code & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_give_back_what_they_hold() {
        for p in [[0, 0, 0], [1, 2, 3], [2047, 0, 1024], [1023, 2047, 5], [0x1F_FFFE, 0x1F_FFFF, 0x15_5555]] {
            for edge in [false, true] {
                let code = encode(p, edge);
                assert_eq!((coordinates(code), is_on_edge(code)), (p, edge));
            }
        }
        // neighbours of a cell of 2³ are neighbours in the order
        let mut cell: Vec<u64> =
            (0..8u32).map(|n| encode([6 + (n & 1), 2 + (n >> 1 & 1), 4 + (n >> 2)], false)).collect();
        cell.sort_unstable();
        assert_eq!(cell[7] - cell[0], 14);
    }
}
