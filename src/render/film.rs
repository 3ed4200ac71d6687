//! Sums of samples per pixel, and the channels that they become (docs/formats.md, section 3).
//!
//! Every contribution of light goes through [`FilmTile::add`] into exactly one layer and one light group, so either set adds
//! up to the beauty by construction, and no non-finite number gets in.

use glam::{DVec2, DVec3, Vec3};

use super::{
    Camera, Mattes,
    cryptomatte::{Coverage, Names},
};
use crate::{
    optics::luminance,
    output::{Channel, SampleType, Window},
};

/// Light by what the camera's ray met first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Mirrored by the water's surface.
    Reflection,
    /// Went into the water; neither scattered in it nor direct light on what lies there.
    Refraction,
    /// Went into the water and was scattered by it.
    Volume,
    /// Sun and lamps that reached what lies in the water through its surface.
    Caustics,
    /// Spray.
    Spray,
    /// Foam on the water.
    Foam,
    /// Mist in the air.
    Mist,
    /// Ground and objects.
    Terrain,
    /// Nothing.
    Sky,
}

impl Layer {
    /// Every layer, in the order of their channels.
    pub const ALL: [Self; 9] = [
        Self::Reflection,
        Self::Refraction,
        Self::Volume,
        Self::Caustics,
        Self::Spray,
        Self::Foam,
        Self::Mist,
        Self::Terrain,
        Self::Sky,
    ];

    /// The name of its channels.
    fn name(self) -> &'static str {
        match self {
            Self::Reflection => "reflection",
            Self::Refraction => "refraction",
            Self::Volume => "volume",
            Self::Caustics => "caustics",
            Self::Spray => "spray",
            Self::Foam => "foam",
            Self::Mist => "mist",
            Self::Terrain => "terrain",
            Self::Sky => "sky",
        }
    }
}

/// Depth where nothing is hit.
pub const NOTHING: f32 = 1e10;

use SampleType::{Float, Half};

/// Channels before the layers of light, beauty first.
const BEFORE: [(&str, SampleType); 21] = [
    ("R", Half),
    ("G", Half),
    ("B", Half),
    ("A", Half),
    ("Z", Float),
    ("N.x", Half),
    ("N.y", Half),
    ("N.z", Half),
    ("P.x", Float),
    ("P.y", Float),
    ("P.z", Float),
    ("forward.u", Float),
    ("forward.v", Float),
    ("backward.u", Float),
    ("backward.v", Float),
    ("albedo.R", Half),
    ("albedo.G", Half),
    ("albedo.B", Half),
    ("dnormal.x", Half),
    ("dnormal.y", Half),
    ("dnormal.z", Half),
];

/// Channels after the layers and groups of light.
const AFTER: [(&str, SampleType); 8] = [
    ("water.depth", Float),
    ("water.path", Float),
    ("mask.foam", Half),
    ("velocity.x", Half),
    ("velocity.y", Half),
    ("velocity.z", Half),
    ("sampleCount", Float),
    ("variance", Float),
];

/// Name and type of every channel but Cryptomatte's of a picture with these light groups, beauty first.
pub fn channels(groups: &[String]) -> Vec<(String, SampleType)> {
    let light = Layer::ALL
        .map(|layer| layer.name().to_owned())
        .into_iter()
        .chain(groups.iter().map(|group| format!("light_{group}")))
        .flat_map(|name| ["R", "G", "B"].map(|color| (format!("{name}.{color}"), Half)));
    let named = |&(name, sample_type): &(&str, SampleType)| (name.to_owned(), sample_type);
    BEFORE.iter().map(named).chain(light).chain(AFTER.iter().map(named)).collect()
}

/// Where a contribution of light goes: a pixel of the tile, and the camera's sample that it is part of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    /// Pixel within the tile.
    pub(super) pixel: u32,
    /// Camera's sample within the chunk of rays under way.
    pub(super) path: u32,
}

/// The moments of a pixel's samples, from which its noise is judged.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
struct Moments {
    samples: u32,
    sum: f64,
    squares: f64,
}

impl Moments {
    /// Variance of the mean luminance, as if samples were independent: they are better spread than that, so it is an
    /// upper bound in practice. 0 until there are two samples.
    fn variance_of_mean(&self) -> f64 {
        if self.samples < 2 {
            return 0.0;
        }
        let n = f64::from(self.samples);
        ((self.squares - self.sum * self.sum / n) / (n - 1.0)).max(0.0) / n
    }
}

/// What the camera's ray met nearest of all samples of a pixel.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Nearest {
    /// Planar depth (m); [`NOTHING`] if nothing was hit.
    pub(super) depth: f32,
    /// The sample it came from.
    pub(super) sample: u32,
    /// Position in the local frame (m).
    pub(super) position: Vec3,
    /// Shading normal.
    pub(super) normal: Vec3,
    /// Velocity of what was hit (m/s).
    pub(super) velocity: Vec3,
    /// Vertical depth of the water there (m).
    pub(super) water_depth: f32,
    /// Length of the first refracted ray (m).
    pub(super) water_path: f32,
}

impl Nearest {
    const NONE: Self = Self {
        depth: NOTHING,
        sample: u32::MAX,
        position: Vec3::ZERO,
        normal: Vec3::ZERO,
        velocity: Vec3::ZERO,
        water_depth: 0.0,
        water_path: 0.0,
    };
}

/// What mist shows of itself in a pixel: sums over its samples.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
struct MistSeen {
    /// Share of the camera's own rays that it has taken.
    weight: f32,
    /// Weighted places in the local frame (m).
    position: Vec3,
    /// Weighted velocities (m/s).
    velocity: Vec3,
}

/// The sums of one tile's pixels.
///
/// Checkpoints hold it as serde writes it: whatever is added here is kept, and goes into [`FilmTile::join`] and
/// [`FilmTile::fits`] too.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct FilmTile {
    /// The pixels, of the full frame.
    pub(super) window: Window,
    /// Layers, then groups, of each pixel.
    light: Vec<Vec3>,
    /// Layers and groups of a pixel.
    stride: usize,
    moments: Vec<Moments>,
    /// Luminance so far of each camera's sample of the chunk under way.
    #[serde(skip)]
    paths: Vec<f32>,
    albedo: Vec<Vec3>,
    normal: Vec<Vec3>,
    /// Weight of the samples that saw a sky that is not to be seen.
    uncovered: Vec<f32>,
    /// Share of the samples that is foam at first sight.
    foam: Vec<f32>,
    nearest: Vec<Nearest>,
    mist: Vec<MistSeen>,
    /// What Cryptomatte tells apart.
    pub(super) coverage: Coverage,
    /// Contributions that were dropped since they were not finite.
    pub(super) nonfinite: u64,
}

impl FilmTile {
    /// Starts over for the pixels of `window`; keeps the memory.
    pub(super) fn reset(&mut self, window: Window, groups: usize) {
        let count = window.width as usize * window.height as usize;
        self.window = window;
        self.nonfinite = 0;
        fn fill<T: Copy>(values: &mut Vec<T>, count: usize, value: T) {
            values.clear();
            values.resize(count, value);
        }
        self.stride = Layer::ALL.len() + groups;
        fill(&mut self.light, count * self.stride, Vec3::ZERO);
        fill(&mut self.moments, count, Moments::default());
        fill(&mut self.albedo, count, Vec3::ZERO);
        fill(&mut self.normal, count, Vec3::ZERO);
        fill(&mut self.uncovered, count, 0.0);
        fill(&mut self.foam, count, 0.0);
        fill(&mut self.nearest, count, Nearest::NONE);
        fill(&mut self.mist, count, MistSeen::default());
        self.coverage.clear();
    }

    /// Starts over for the pixels and groups of another tile; keeps the memory.
    pub(super) fn reset_as(&mut self, other: &Self) {
        self.reset(other.window, other.stride - Layer::ALL.len());
    }

    /// Adds the sums of later samples of the same pixels. Sums of a block of samples are made by themselves and then
    /// joined in order, so that blocks made elsewhere join to the same bits.
    pub(super) fn join(&mut self, later: &Self) {
        fn add<T: Copy + std::ops::AddAssign>(sums: &mut [T], later: &[T]) {
            for (sum, &value) in sums.iter_mut().zip(later) {
                *sum += value;
            }
        }
        add(&mut self.light, &later.light);
        add(&mut self.albedo, &later.albedo);
        add(&mut self.normal, &later.normal);
        add(&mut self.uncovered, &later.uncovered);
        add(&mut self.foam, &later.foam);
        for (sum, later) in self.moments.iter_mut().zip(&later.moments) {
            sum.samples += later.samples;
            sum.sum += later.sum;
            sum.squares += later.squares;
        }
        for (sum, later) in self.mist.iter_mut().zip(&later.mist) {
            sum.weight += later.weight;
            sum.position += later.position;
            sum.velocity += later.velocity;
        }
        for (nearest, later) in self.nearest.iter_mut().zip(&later.nearest) {
            if later.depth < nearest.depth {
                *nearest = *later;
            }
        }
        self.coverage.join(&later.coverage);
        self.nonfinite += later.nonfinite;
    }

    /// Whether these are the sums of `window` with so many light groups: one of everything for each pixel.
    pub(super) fn fits(&self, window: Window, groups: usize, names: &Names) -> bool {
        let count = window.area();
        self.window == window
            && self.stride == Layer::ALL.len() + groups
            && self.light.len() == count * self.stride
            && [self.moments.len(), self.albedo.len(), self.normal.len(), self.uncovered.len()] == [count; 4]
            && [self.foam.len(), self.nearest.len(), self.mist.len()] == [count; 3]
            && self.coverage.is_of(names)
    }

    /// Starts a chunk of so many of the camera's samples.
    pub(super) fn begin(&mut self, paths: usize) {
        self.paths.clear();
        self.paths.resize(paths, 0.0);
    }

    /// Ends the chunk: `pixels` says whose each sample was.
    pub(super) fn end(&mut self, pixels: impl Iterator<Item = u32>) {
        for (pixel, &luminance) in pixels.zip(&self.paths) {
            let moments = &mut self.moments[pixel as usize];
            moments.samples += 1;
            moments.sum += f64::from(luminance);
            moments.squares += f64::from(luminance) * f64::from(luminance);
        }
    }

    /// Adds light to a layer and a group. A contribution that is not finite is dropped and counted, a negative one is none.
    #[inline]
    pub(super) fn add(&mut self, place: Place, layer: Layer, group: u16, light: Vec3) {
        if light.is_finite() {
            let light = light.max(Vec3::ZERO);
            let pixel = &mut self.light[place.pixel as usize * self.stride..][..self.stride];
            pixel[layer as usize] += light;
            pixel[Layer::ALL.len() + usize::from(group)] += light;
            self.paths[place.path as usize] += luminance(light);
        } else {
            self.nonfinite += 1;
        }
    }

    /// Samples that a pixel has.
    pub(super) fn samples(&self, pixel: u32) -> u32 {
        self.moments[pixel as usize].samples
    }

    /// Samples of the pixel that has most.
    pub(super) fn greatest_samples(&self) -> u32 {
        self.moments.iter().map(|moments| moments.samples).max().unwrap_or(0)
    }

    /// Samples of all pixels.
    pub(super) fn all_samples(&self) -> u64 {
        self.moments.iter().map(|moments| u64::from(moments.samples)).sum()
    }

    /// Standard error of a pixel's luminance relative to that luminance and `floor` together.
    pub(super) fn relative_error(&self, pixel: u32, floor: f64) -> f64 {
        let moments = &self.moments[pixel as usize];
        let mean = moments.sum / f64::from(moments.samples.max(1));
        moments.variance_of_mean().sqrt() / (mean + floor)
    }

    /// Adds to the denoiser's guides: albedo and normal of what is seen with `weight`.
    #[inline]
    pub(super) fn add_guide(&mut self, pixel: u32, weight: f32, albedo: Vec3, normal: Vec3) {
        let (albedo, normal) = (weight * albedo, weight * normal);
        if albedo.is_finite() && normal.is_finite() {
            self.albedo[pixel as usize] += albedo;
            self.normal[pixel as usize] += normal;
        } else {
            self.nonfinite += 1;
        }
    }

    /// Notes that a share of one sample saw a sky that is not to be seen.
    #[inline]
    pub(super) fn add_uncovered(&mut self, pixel: u32, weight: f32) {
        self.uncovered[pixel as usize] += weight;
    }

    /// Notes that a share of one sample is foam at first sight.
    #[inline]
    pub(super) fn add_foam(&mut self, pixel: u32, cover: f32) {
        self.foam[pixel as usize] += cover;
    }

    /// Takes `hit` if it is nearer than what the pixel has.
    #[inline]
    pub(super) fn offer(&mut self, pixel: u32, hit: Nearest) {
        let nearest = &mut self.nearest[pixel as usize];
        if hit.depth < nearest.depth {
            *nearest = hit;
        }
    }

    /// Notes that mist at `position` (m) took a share of one of the camera's own rays.
    #[inline]
    pub(super) fn add_mist(&mut self, pixel: u32, weight: f32, position: Vec3, velocity: Vec3) {
        let seen = &mut self.mist[pixel as usize];
        seen.weight += weight;
        seen.position += weight * position;
        seen.velocity += weight * velocity;
    }

    /// What is nearest in a pixel: mist, where it stops half of what the pixel sees or more, if it lies before the nearest
    /// hit; in the mean, since each sample meets it elsewhere. Thinner mist is a veil before something else.
    fn nearest(&self, index: usize, view: &View) -> Nearest {
        let (hit, mist) = (self.nearest[index], self.mist[index]);
        if !(mist.weight >= 0.5 * self.moments[index].samples as f32 && mist.weight > 0.0) {
            return hit;
        }
        let position = mist.position / mist.weight;
        let depth = view.camera.depth(view.origin + position.as_dvec3()) as f32;
        if !(depth < hit.depth) {
            return hit;
        }
        Nearest { depth, position, velocity: mist.velocity / mist.weight, ..Nearest::NONE }
    }

    /// Notes the length of the first refracted ray, if `sample` is the one that gave the depth.
    #[inline]
    pub(super) fn note_path(&mut self, pixel: u32, sample: u32, path: f32) {
        let nearest = &mut self.nearest[pixel as usize];
        if nearest.sample == sample {
            nearest.water_path = path;
        }
    }

    /// The channels of every pixel, in the order of [`channels`].
    pub(super) fn resolve(&self, view: &View, pixels: &mut Vec<f32>) {
        pixels.clear();
        for index in 0..self.moments.len() {
            let x = self.window.x + (index % self.window.width as usize) as i32;
            let y = self.window.y + (index / self.window.width as usize) as i32;
            self.resolve_pixel(index, DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), view, pixels);
        }
    }

    /// Mean radiance of a pixel by layer, then by light group.
    fn light_of(&self, index: usize) -> impl Iterator<Item = Vec3> + Clone {
        let share = 1.0 / self.moments[index].samples.max(1) as f32;
        // The sum of finite numbers may overflow: it stays finite here, and the file's own limit comes later.
        let sums = self.light[index * self.stride..][..self.stride].iter();
        sums.map(move |&sum| (sum * share).min(Vec3::splat(f32::MAX)))
    }

    /// Red, green, blue and alpha of a pixel.
    fn beauty(&self, index: usize) -> [f32; 4] {
        let share = 1.0 / self.moments[index].samples.max(1) as f32;
        let beauty = self.light_of(index).take(Layer::ALL.len()).fold(Vec3::ZERO, |sum, layer| sum + layer);
        let alpha = (1.0 - self.uncovered[index] * share).clamp(0.0, 1.0);
        beauty.min(Vec3::splat(f32::MAX)).extend(alpha).to_array()
    }

    /// [`FilmTile::resolve`]'s first four values of every pixel.
    pub(super) fn beauties(&self) -> Vec<[f32; 4]> {
        (0..self.moments.len()).map(|index| self.beauty(index)).collect()
    }

    fn resolve_pixel(&self, index: usize, centre: DVec2, view: &View, values: &mut Vec<f32>) {
        let moments = &self.moments[index];
        let share = 1.0 / moments.samples.max(1) as f32;
        let nearest = self.nearest(index, view);
        let hit = nearest.depth < NOTHING;
        let world = if hit { view.origin + nearest.position.as_dvec3() } else { DVec3::ZERO };
        let motion = |camera: &Camera, frames: f64| {
            let (now, then) = if hit {
                let moved = world + nearest.velocity.as_dvec3() * (frames / view.fps);
                (view.camera.project(world), camera.project(moved))
            } else {
                (Some(centre), camera.project_direction(view.camera.direction(centre)))
            };
            // What is behind the eye at that frame has no place in its picture: no motion is written.
            match (now, then) {
                (Some(now), Some(then)) => [(then.x - now.x) as f32, (now.y - then.y) as f32],
                _ => [0.0; 2],
            }
        };
        let (forward, backward) = (motion(&view.next, 1.0), motion(&view.previous, -1.0));
        let light = self.light_of(index);
        let (albedo, dnormal) = (self.albedo[index] * share, self.normal[index] * share);

        values.extend(self.beauty(index));
        values.push(nearest.depth);
        values.extend(nearest.normal.to_array());
        values.extend(world.as_vec3().to_array());
        values.extend(forward);
        values.extend(backward);
        values.extend(albedo.to_array());
        values.extend(dnormal.to_array());
        for layer in light {
            values.extend(layer.to_array());
        }
        values.extend([nearest.water_depth, nearest.water_path, self.foam[index] * share]);
        values.extend(nearest.velocity.to_array());
        let variance = moments.variance_of_mean().min(f64::from(f32::MAX));
        values.extend([moments.samples as f32, variance as f32]);
        view.names.resolve(self.coverage.pixel(index), share, values);
    }
}

/// What resolving a pixel needs to know of the whole picture.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct View {
    /// The camera now.
    pub(super) camera: Camera,
    /// The camera a frame later.
    pub(super) next: Camera,
    /// The camera a frame earlier.
    pub(super) previous: Camera,
    /// Where the local frame's zero lies (m).
    pub(super) origin: DVec3,
    /// Frames per second.
    pub(super) fps: f64,
    /// Names of what Cryptomatte tells apart.
    pub(super) names: Names,
}

/// The channels of a whole data window; pixels that no tile has filled are 0.
#[derive(Debug)]
pub(super) struct Film {
    data: Window,
    channels: Vec<Channel>,
}

impl Film {
    /// An empty film.
    pub(super) fn new(data: Window, groups: &[String], mattes: Mattes) -> Self {
        let count = data.width as usize * data.height as usize;
        let channels = channels(groups)
            .into_iter()
            .chain(mattes.channels().map(|name| (name, Float)))
            .map(|(name, sample_type)| Channel { name, sample_type, samples: vec![0.0; count] })
            .collect();
        Self { data, channels }
    }

    /// Copies a tile's pixels to their place.
    pub(super) fn place(&mut self, window: Window, pixels: &[f32]) {
        let (width, stride) = (window.width as usize, self.channels.len());
        for (index, channel) in self.channels.iter_mut().enumerate() {
            for (row, line) in pixels.chunks_exact(width * stride).enumerate() {
                let y = (window.y - self.data.y) as usize + row;
                let start = y * self.data.width as usize + (window.x - self.data.x) as usize;
                for (sample, pixel) in channel.samples[start..start + width].iter_mut().zip(line.chunks_exact(stride)) {
                    *sample = pixel[index];
                }
            }
        }
    }

    /// The channels.
    pub(super) fn into_channels(self) -> Vec<Channel> {
        self.channels
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Pose;

    fn window(x: i32, y: i32, width: u32, height: u32) -> Window {
        Window { x, y, width, height }
    }

    fn camera(eye: DVec3) -> Camera {
        Camera::new(Pose::looking(eye, eye + DVec3::new(0.5, -0.2, -4.0), DVec3::Y, 50.0, None).unwrap(), (64, 48), 0.0)
    }

    fn view() -> View {
        let eye = DVec3::new(1.0e5, 3.0, 2.0);
        let step = DVec3::new(0.3, 0.1, 0.0);
        View {
            camera: camera(eye),
            next: camera(eye + step),
            previous: camera(eye - 2.0 * step),
            origin: DVec3::new(1.0e5, 0.0, 0.0),
            fps: 24.0,
            names: Names::default(),
        }
    }

    fn groups() -> [String; 2] {
        ["sun", "sky"].map(str::to_owned)
    }

    fn value(pixels: &[f32], pixel: usize, name: &str) -> f32 {
        let channels = channels(&groups());
        pixels[pixel * channels.len() + channels.iter().position(|channel| channel.0 == name).unwrap()]
    }

    /// A tile of which every pixel has had four of the camera's samples.
    fn tile(window: Window) -> FilmTile {
        let mut tile = FilmTile::default();
        tile.reset(window, 2);
        let pixels = window.width * window.height;
        tile.begin(4 * pixels as usize);
        tile.end((0..4 * pixels).map(|path| path / 4));
        tile
    }

    fn at(pixel: u32) -> Place {
        Place { pixel, path: 4 * pixel }
    }

    #[test]
    fn light_that_is_not_finite_is_dropped_and_counted() {
        let mut tile = tile(window(0, 0, 2, 1));
        tile.add(at(1), Layer::Spray, 0, Vec3::new(f32::NAN, 1.0, 1.0));
        tile.add(at(1), Layer::Sky, 0, Vec3::new(1.0, f32::INFINITY, 1.0));
        tile.add(at(1), Layer::Sky, 0, Vec3::new(4.0, -3.0, 8.0));
        tile.add(at(1), Layer::Terrain, 0, Vec3::splat(f32::MAX));
        tile.add(at(1), Layer::Terrain, 0, Vec3::splat(f32::MAX));
        tile.add_guide(1, f32::NAN, Vec3::ONE, Vec3::Y);
        assert_eq!(tile.nonfinite, 3);
        let mut pixels = Vec::new();
        tile.resolve(&view(), &mut pixels);
        assert!(pixels.iter().all(|value| value.is_finite()));
        assert_eq!(
            [value(&pixels, 1, "sky.R"), value(&pixels, 1, "sky.G"), value(&pixels, 1, "sky.B")],
            [1.0, 0.0, 2.0]
        );
    }

    #[test]
    fn layers_add_up_to_the_beauty() {
        let mut tile = tile(window(0, 0, 1, 1));
        for (index, layer) in Layer::ALL.into_iter().enumerate() {
            tile.add(at(0), layer, (index % 2) as u16, Vec3::new(0.1, 1.7, 13.0) * (index + 1) as f32);
        }
        let mut pixels = Vec::new();
        tile.resolve(&view(), &mut pixels);
        for channel in ["R", "G", "B"] {
            let beauty = value(&pixels, 0, channel);
            for by_group in [false, true] {
                let sum: f32 = channels(&groups())
                    .iter()
                    .map(|(name, _)| name)
                    .filter(|name| name.ends_with(&format!(".{channel}")) && !name.starts_with("albedo"))
                    .filter(|name| name.starts_with("light_") == by_group)
                    .map(|name| value(&pixels, 0, name))
                    .sum();
                assert!((sum - beauty).abs() <= 1e-6 * beauty && beauty > 0.0, "{channel}: {sum} {beauty}");
            }
        }
    }

    #[test]
    fn motion_is_the_projection_of_where_things_go() {
        let view = view();
        let mut tile = tile(window(10, 12, 2, 1));
        let (position, velocity) = (Vec3::new(2.0, 2.0, -9.0), Vec3::new(2.4, 0.0, 4.8));
        tile.offer(0, Nearest { depth: 3.0, sample: 0, position, velocity, ..Nearest::NONE });
        // A farther sample must not replace it.
        tile.offer(0, Nearest { depth: 5.0, sample: 1, ..Nearest::NONE });
        let mut pixels = Vec::new();
        tile.resolve(&view, &mut pixels);

        // By hand: coordinates along the axes of the camera, divided by depth and scaled to 48 pixels in 50 degrees.
        let by_hand = |camera: &Camera, point: DVec3| {
            let pose = camera.pose;
            let offset = point - pose.eye;
            let scale = 24.0 / 25.0_f64.to_radians().tan() / offset.dot(pose.forward);
            (offset.dot(pose.right) * scale, offset.dot(pose.up) * scale)
        };
        let world = view.origin + position.as_dvec3();
        let step = velocity.as_dvec3() / 24.0;
        let now = by_hand(&view.camera, world);
        let next = by_hand(&view.next, world + step);
        let previous = by_hand(&view.previous, world - step);
        for (name, expected) in [
            ("forward.u", next.0 - now.0),
            ("forward.v", next.1 - now.1),
            ("backward.u", previous.0 - now.0),
            ("backward.v", previous.1 - now.1),
        ] {
            let got = f64::from(value(&pixels, 0, name));
            assert!((got - expected).abs() < 1e-4 && expected.abs() > 0.1, "{name}: {got} against {expected}");
        }
        assert_eq!(value(&pixels, 0, "Z"), 3.0);
        // The sky is so far that a camera that only moves aside does not shift it.
        assert_eq!(value(&pixels, 1, "Z"), NOTHING);
        assert!(value(&pixels, 1, "forward.u").abs() < 1e-4 && value(&pixels, 1, "backward.v").abs() < 1e-4);
        assert_eq!([value(&pixels, 1, "P.x"), value(&pixels, 1, "N.y")], [0.0; 2]);
    }

    #[test]
    fn tiles_land_in_their_place_of_the_data_window() {
        let mut film = Film::new(window(-3, 5, 5, 3), &groups(), Mattes::default());
        let stride = channels(&groups()).len();
        let pixels: Vec<f32> = (1..=4).flat_map(|value| vec![value as f32; stride]).collect();
        film.place(window(0, 6, 2, 2), &pixels);
        let channels = film.into_channels();
        assert_eq!(channels[0].samples, [0., 0., 0., 0., 0., 0., 0., 0., 1., 2., 0., 0., 0., 3., 4.]);
    }

    #[test]
    fn noise_is_judged_by_whole_samples() {
        let mut tile = FilmTile::default();
        tile.reset(window(0, 0, 1, 1), 1);
        for chunk in [[1.0, 3.0], [2.0, 6.0]] {
            tile.begin(2);
            for (path, value) in chunk.into_iter().enumerate() {
                // In two parts: a sample's light comes from several rays.
                let place = Place { pixel: 0, path: path as u32 };
                tile.add(place, Layer::Sky, 0, Vec3::splat(0.5 * value));
                tile.add(place, Layer::Terrain, 0, Vec3::splat(0.5 * value));
            }
            tile.end([0, 0].into_iter());
        }
        // Of 1, 3, 2, 6: mean 3, variance 14/3, of the mean 14/12.
        let error = (14.0_f64 / 12.0).sqrt() / 3.5;
        assert!((tile.relative_error(0, 0.5) - error).abs() < 1e-6);
        assert_eq!(tile.samples(0), 4);
    }
}
