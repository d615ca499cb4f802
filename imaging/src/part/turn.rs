//! Facets turned alike, and outwards.

use super::edges::Edges;
use super::{Facets, PartError};

/// Turns facets so that neighbours agree and the solid's volume is positive; how many were turned. The surface is one piece.
///
/// # Errors
/// [`PartError::OneSided`] when that cannot be.
pub(crate) fn turn_outwards(facets: &mut Facets, edges: &Edges) -> Result<usize, PartError> {
    let mut is_turned = agreeing(facets, edges)?;
    let signed: f64 = (0..facets.triangles.len())
        .map(|f| {
            let [a, b, c] = facets.corners(f);
            a.dot(&b.cross(&c)) * if is_turned[f] { -1.0 } else { 1.0 }
        })
        .sum();
    if signed < 0.0 {
        is_turned.iter_mut().for_each(|turned| *turned = !*turned);
    }
    for (triangle, _) in facets.triangles.iter_mut().zip(&is_turned).filter(|(_, turned)| **turned) {
        triangle.swap(1, 2);
    }
    Ok(is_turned.iter().filter(|turned| **turned).count())
}

/// Which facets must be turned so that all agree with the first of their piece.
fn agreeing(facets: &Facets, edges: &Edges) -> Result<Vec<bool>, PartError> {
    let mut turned: Vec<Option<bool>> = vec![None; facets.triangles.len()];
    for start in 0..turned.len() as u32 {
        if turned[start as usize].is_some() {
            continue;
        }
        turned[start as usize] = Some(false);
        let mut stack = vec![start];
        while let Some(f) = stack.pop() {
            let own = turned[f as usize] == Some(true);
            for (h, g) in (3 * f..3 * f + 3).filter_map(|h| Some((h, edges.twin(h)?))) {
                // neighbours agree when they run along their edge in opposite senses
                let same_sense = edges.ends(facets, h)[0] == edges.ends(facets, g)[0];
                let needed = own != same_sense;
                match &mut turned[g as usize / 3] {
                    Some(found) if *found != needed => {
                        return Err(PartError::OneSided { place: facets.place(g as usize / 3) });
                    }
                    Some(_) => {}
                    unseen => {
                        *unseen = Some(needed);
                        stack.push(g / 3);
                    }
                }
            }
        }
    }
    Ok(turned.into_iter().map(|turned| turned == Some(true)).collect())
}
