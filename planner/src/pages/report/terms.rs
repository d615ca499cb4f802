//! The terms that the report uses, for a reader who sees it for the first time.

/// A closed list of terms, for the top of the page.
pub const TERMS: &str = "<details><summary>Terms on this page</summary><table class=\"words\"><tbody>\
<tr><th>target</th><td>the bone to be removed, air cells included</td></tr>\
<tr><th>structure</th><td>an anatomical part that the burr and its shank must not touch</td></tr>\
<tr><th>clearance</th><td>the least distance that the case allows between a structure and the burr's surface</td></tr>\
<tr><th>approach</th><td>the direction out of the bone from which the target is milled; z of the frame work</td></tr>\
<tr><th>tilt</th><td>the angle between the shaft and the approach</td></tr>\
<tr><th>waypoint</th><td>one position of the burr's centre; its row in waypoints.csv also describes the move that ends there</td></tr>\
<tr><th>cut, link, retract</th><td>a move that removes material; a move through free space to the next pass; a move out of the bone or back in</td></tr>\
<tr><th>layer</th><td>a slab of bone across the approach that is milled before the next one; 0 is the outermost</td></tr>\
<tr><th>force</th><td>the predicted mean force on the burr over one turn</td></tr>\
<tr><th>force toward a structure</th><td>the force's component toward the nearest point of the structure; 0 if it points away (Dillon et al. 2016: F<sub>v</sub>)</td></tr>\
</tbody></table></details>";
