//! The smallest block that holds a box, and how it is mounted: which of its sides lies along which axis.

use super::StockBlock;

/// A block as it is mounted.
#[derive(Debug, Clone, PartialEq)]
pub struct Mounted {
    /// Its number.
    pub id: String,
    /// Its sides along x, y and z, mm.
    pub size_mm: [f64; 3],
}

/// The block of least volume that is there and holds a box of these sides along x, y and z, mm; the first number of equals.
///
/// Of the ways to mount it, the one with the least side along y is taken, then along x: what is cut away beside the part is then thinnest.
pub fn smallest(blocks: &[StockBlock], needed_mm: [f64; 3]) -> Option<Mounted> {
    let there = blocks.iter().filter(|block| block.count > 0);
    let mounted =
        there.filter_map(|block| Some((block.size_mm.iter().product::<f64>(), mount(block, needed_mm)?)));
    mounted.min_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.id.cmp(&b.1.id))).map(|(_, mounted)| mounted)
}

fn mount(block: &StockBlock, needed_mm: [f64; 3]) -> Option<Mounted> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let ways = ORDERS.map(|order| order.map(|n| block.size_mm[n])).into_iter();
    let fits = ways.filter(|size| size.iter().zip(needed_mm).all(|(side, needed)| *side >= needed));
    let size_mm = fits.min_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])))?;
    Some(Mounted { id: block.id.clone(), size_mm })
}
