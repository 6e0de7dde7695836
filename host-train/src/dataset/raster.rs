//! Depth images of meshes: a pinhole camera and a z-buffer.

use super::mesh::Mesh;
use glam::{Affine3A, Vec2, Vec3};

/// Triangles nearer than this, in the mesh's units, are not drawn.
const NEAR: f32 = 1e-3;

/// A pinhole camera that looks along z, with x to the right and y down. Pixel `(u, v)` sees the direction
/// `((u - cx) / fx, (v - cy) / fy, 1)`: centres of pixels lie at whole numbers, as in OpenCV and BOP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Columns and rows of the image.
    pub size: [usize; 2],
    /// `(fx, fy)`, pixels.
    pub focal: Vec2,
    /// `(cx, cy)`, pixels.
    pub centre: Vec2,
}

/// A vertex as a camera sees it.
#[derive(Clone, Copy)]
struct Corner {
    pixel: Vec2,
    inverse_depth: f32,
    /// Whether it is far enough in front of the camera.
    is_ahead: bool,
}

impl Pinhole {
    /// The ray through a pixel's centre, to depth 1.
    pub fn ray(&self, column: usize, row: usize) -> Vec3 {
        let pixel = Vec2::new(column as f32, row as f32);
        ((pixel - self.centre) / self.focal).extend(1.0)
    }

    /// Whether the optical axis meets the image plane outside of the image, as in a crop or an image of another size.
    pub fn is_off_centre(&self) -> bool {
        let [width, height] = self.size.map(|pixels| pixels as f32);
        let Vec2 { x, y } = self.centre;
        let is_inside = |at: f32, pixels: f32| (-0.5..=pixels - 0.5).contains(&at);
        !(is_inside(x, width) && is_inside(y, height))
    }

    /// Pixel at which a point is seen; meaningless for a depth that is not positive.
    pub fn project(&self, point: Vec3) -> Vec2 {
        self.centre + self.focal / point.z * point.truncate()
    }

    /// Inverse depth of the nearest surface at each pixel, row by row; 0 where there is none. Triangles that reach
    /// behind the camera are left out.
    pub fn inverse_depths(&self, mesh: &Mesh, camera_from_mesh: &Affine3A) -> Vec<f32> {
        let mut image = vec![0.0f32; self.size[0] * self.size[1]];
        let seen = |vertex: &Vec3| self.see(camera_from_mesh.transform_point3(*vertex));
        let seen: Vec<Corner> = mesh.vertices.iter().map(seen).collect();
        for face in &mesh.faces {
            let corners = face.map(|index| seen.get(index as usize).copied());
            if let [Some(a), Some(b), Some(c)] = corners
                && [a, b, c].iter().all(|corner| corner.is_ahead)
            {
                self.fill([a, b, c], &mut image);
            }
        }
        image
    }

    fn see(&self, point: Vec3) -> Corner {
        Corner {
            pixel: self.project(point),
            inverse_depth: 1.0 / point.z,
            // NaN is not.
            is_ahead: point.z > NEAR,
        }
    }

    /// Draws one triangle; the inverse depth is linear in the image.
    fn fill(&self, corners: [Corner; 3], image: &mut [f32]) {
        let [width, height] = self.size;
        let [a, b, c] = corners.map(|corner| corner.pixel);
        let doubled_area = (b - a).perp_dot(c - a);
        if doubled_area == 0.0 || !doubled_area.is_finite() {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let first = |x: f32| x.ceil().max(0.0) as usize;
        let end = |x: f32, size: usize| ((x.floor() + 1.0).max(0.0) as usize).min(size);
        let (rows, columns) = (
            first(low.y)..end(high.y, height),
            first(low.x)..end(high.x, width),
        );
        if rows.is_empty() || columns.is_empty() {
            return;
        }
        // Barycentric weights, one per component, and their contributions to the inverse depth.
        let edges = [(b, c), (c, a), (a, b)].map(|(from, to)| ((to - from) / doubled_area, from));
        let weights_at =
            |p: Vec2| Vec3::from_array(edges.map(|(edge, from)| edge.perp_dot(p - from)));
        let right = Vec3::from_array(edges.map(|(edge, _)| -edge.y));
        let each = right.recip();
        let inverses = Vec3::from_array(corners.map(|corner| corner.inverse_depth));
        for row in rows {
            let first = weights_at(Vec2::new(columns.start as f32, row as f32));
            let pixels = &mut image[row * width..][columns.clone()];
            let inside = match pixels.len() {
                ..=FEW => 0..pixels.len(),
                count => span(first, each, count),
            };
            let along = inside.start as i32..;
            // Without branches, so that several pixels are computed at a time.
            for (along, pixel) in along.zip(&mut pixels[inside]) {
                let weights = first + right * along as f32;
                let inverse = weights.dot(inverses);
                let is_inside = (weights.x >= 0.0) & (weights.y >= 0.0) & (weights.z >= 0.0);
                let is_nearer = is_inside & (inverse > *pixel);
                *pixel = if is_nearer { inverse } else { *pixel };
            }
        }
    }
}

/// Pixels of a row that are all looked at sooner than the outer ones are found.
const FEW: usize = 8;

/// The pixels of a row outside of which a weight is negative, and perhaps a few more: from the weights at the first pixel and the
/// inverses of their growth from one pixel to the next. Of a sliver, few are left.
fn span(first: Vec3, each: Vec3, count: usize) -> std::ops::Range<usize> {
    // Where a weight is 0; NaN where it nowhere changes.
    let zeros = (-first * each).to_array();
    let (mut start, mut end) = (0.0f32, count as f32);
    for (zero, each) in zeros.into_iter().zip(each.to_array()) {
        // A pixel more than rounding can take.
        if each > 0.0 {
            start = start.max(zero - 1.0);
        } else {
            end = end.min(zero + 2.0);
        }
    }
    let end = end as usize;
    (start as usize).min(end)..end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use rand::RngExt;

    /// Every pixel inside of a triangle is drawn, however thin that is: as if all of its bounding box were looked at.
    #[test]
    fn spans_leave_no_pixel_out() {
        let mut rng = stream(5, Purpose::Surface, 0);
        for thin in [1.0, 0.1, 0.001, 0.0] {
            for _ in 0..300 {
                let mut corner =
                    || Vec2::from_array([(); 2].map(|()| rng.random_range(-20.0..60.0f32)));
                let (a, b, c) = (corner(), corner(), corner());
                let c = a.lerp(b, 0.4) + (c - a) * thin;
                let doubled_area = (b - a).perp_dot(c - a);
                let edges =
                    [(b, c), (c, a), (a, b)].map(|(from, to)| ((to - from) / doubled_area, from));
                let right = Vec3::from_array(edges.map(|(edge, _)| -edge.y));
                for row in 0..40 {
                    let at = Vec2::new(0.0, row as f32);
                    let first =
                        Vec3::from_array(edges.map(|(edge, from)| edge.perp_dot(at - from)));
                    let is_inside =
                        |along: usize| (first + right * along as f32).min_element() >= 0.0;
                    let span = span(first, right.recip(), 40);
                    assert!(span.end <= 40);
                    let left_out = (0..40).filter(|along| !span.contains(along));
                    assert!(
                        left_out.into_iter().all(|along| !is_inside(along)),
                        "{a} {b} {c} {row}"
                    );
                }
            }
        }
    }

    /// A slanted plane `z = 4 + x` drawn by two triangles has, at every pixel, the depth at which the pixel's
    /// ray meets it.
    #[test]
    fn depths_are_where_rays_meet_the_plane() {
        let camera = Pinhole {
            size: [9, 7],
            focal: Vec2::new(10.0, 12.0),
            centre: Vec2::new(3.7, 2.9),
        };
        let corner = |x: f32, y: f32| Vec3::new(x, y, x);
        let mesh = Mesh {
            vertices: vec![
                corner(-3.0, -9.0),
                corner(9.0, -9.0),
                corner(9.0, 9.0),
                corner(-3.0, 9.0),
            ],
            faces: vec![[0, 1, 2], [0, 2, 3]],
        };
        let place = Affine3A::from_translation(Vec3::Z * 4.0);
        let image = camera.inverse_depths(&mesh, &place);
        for (i, inverse) in image.iter().enumerate() {
            let ray = camera.ray(i % 9, i / 9);
            let depth = 4.0 / (1.0 - ray.x);
            assert!((1.0 / inverse - depth).abs() < 1e-4, "pixel {i}");
            let back = camera.project(ray * depth);
            let pixel = Vec2::new((i % 9) as f32, (i / 9) as f32);
            assert!(back.distance(pixel) < 1e-4);
        }
    }

    #[test]
    fn what_is_behind_the_camera_is_not_drawn() {
        let camera = Pinhole {
            size: [4, 4],
            focal: Vec2::splat(4.0),
            centre: Vec2::splat(1.5),
        };
        let mesh = Mesh {
            vertices: vec![Vec3::new(-9.0, -9.0, 1.0), Vec3::X * 9.0, Vec3::Y * 9.0],
            faces: vec![[0, 1, 2], [0, 1, 7]],
        };
        let image = camera.inverse_depths(&mesh, &Affine3A::IDENTITY);
        assert!(image.iter().all(|&d| d == 0.0));
    }
}
