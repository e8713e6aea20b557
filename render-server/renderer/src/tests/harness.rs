//! Shapes, scenes and cameras for the tests.

use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4, Vec2, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_renderer::{
    AllowedError, DrawStats, Gpu, GpuScene, Renderer, SceneBuilder, SceneLayout, Target, ViewDesc,
    read_pixels,
};
use polyptych_scene::meshlet::{ErrorSphere, Meshlet};
use polyptych_scene::{
    IndexFormat, Material, Mesh, Node, NodeTraits, Primitive, Sampler, Scene, SceneSubset, Texture,
    TextureFormat, ToneMapper, Topology, VertexLayout, Wrap,
};

/// The one adapter of all tests.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| Gpu::headless().unwrap_or_else(|error| panic!("{error}")))
}

/// Vertices with position, normal, tangent and texture coordinates.
#[derive(Clone, Default)]
pub struct MeshFixture {
    pub vertices: Vec<[f32; 12]>,
    /// The second coordinates of each vertex; none if empty.
    pub second_uvs: Vec<[f32; 2]>,
    pub indices: Vec<u32>,
    pub coarser_indices: Vec<u32>,
    pub meshlets: Vec<Meshlet>,
    /// The level that is drawn as the finest one.
    pub finest_level: u32,
    /// `true` if the blob has the coarsest meshlets first.
    pub is_coarse_first: bool,
}

impl MeshFixture {
    pub const LAYOUT: VertexLayout =
        VertexLayout { tangent: true, uv0: true, uv1: false, color: false };

    pub fn push(&mut self, p: Vec3, n: Vec3, t: Vec3, uv: Vec2) -> u32 {
        self.vertices.push([p.x, p.y, p.z, n.x, n.y, n.z, t.x, t.y, t.z, 1.0, uv.x, uv.y]);
        self.vertices.len() as u32 - 1
    }

    /// A unit sphere.
    pub fn sphere(rings: u32) -> Self {
        let mut shape = Self::default();
        let sectors = rings * 2;
        for ring in 0..=rings {
            for sector in 0..=sectors {
                let (v, u) = (ring as f32 / rings as f32, sector as f32 / sectors as f32);
                let (polar, azimuth) = (v * std::f32::consts::PI, u * std::f32::consts::TAU);
                let (sin, cos) = polar.sin_cos();
                let p = Vec3::new(sin * azimuth.sin(), cos, sin * azimuth.cos());
                let t = Vec3::new(azimuth.cos(), 0.0, -azimuth.sin());
                shape.push(p, p, t, Vec2::new(u, v) * 4.0);
            }
        }
        for ring in 0..rings {
            for sector in 0..sectors {
                let a = ring * (sectors + 1) + sector;
                let b = a + sectors + 1;
                shape.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
            }
        }
        shape
    }

    /// A rectangle of half sides x and y in the plane z = 0, seen from +z.
    pub fn rectangle(x: f32, y: f32) -> Self {
        let mut shape = Self::default();
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let uv = Vec2::new(sx * 0.5 + 0.5, 0.5 - sy * 0.5);
            shape.push(Vec3::new(sx * x, sy * y, 0.0), Vec3::Z, Vec3::X, uv);
        }
        shape.indices.extend([0, 1, 2, 0, 2, 3]);
        shape
    }

    /// One triangle.
    pub fn triangle(corners: [Vec3; 3], normal: Vec3) -> Self {
        let mut shape = Self::default();
        for (corner, uv) in corners.into_iter().zip([Vec2::ZERO, Vec2::X, Vec2::Y]) {
            shape.push(corner, normal, Vec3::X, uv);
        }
        shape.indices.extend([0, 1, 2]);
        shape
    }

    /// Adds meshlets of `triangles` triangles each. All are of the finest level and have none that
    /// replace them.
    pub fn with_meshlets(mut self, triangles: usize) -> Self {
        let runs = self.indices.chunks(triangles * 3).enumerate();
        let meshlets = runs.map(|(at, run)| self.meshlet((at * triangles * 3) as u32, run));
        self.meshlets = meshlets.collect();
        self
    }

    /// A meshlet of these triangles, which begin at an index; without error, and not replaced.
    pub fn meshlet(&self, first_index: u32, triangles: &[u32]) -> Meshlet {
        let point = |index: &u32| Vec3::from_slice(&self.vertices[*index as usize][..3]);
        let min = triangles.iter().map(point).fold(Vec3::INFINITY, Vec3::min);
        let max = triangles.iter().map(point).fold(Vec3::NEG_INFINITY, Vec3::max);
        // A triangle without area is not drawn, wherever it faces.
        let normals = || {
            triangles.as_chunks::<3>().0.iter().filter_map(|triangle| {
                let [a, b, c] = [0, 1, 2].map(|corner| point(&triangle[corner]).as_dvec3());
                (b - a).cross(c - a).try_normalize()
            })
        };
        let axis = normals().sum::<DVec3>().normalize_or_zero();
        let cosine = normals().map(|normal| normal.dot(axis)).fold(1.0, f64::min);
        let has_cone = cosine > 0.17;
        let sphere = ErrorSphere { center: (min + max) * 0.5, radius: (max - min).length() * 0.5 };
        Meshlet {
            first_index,
            index_count: triangles.len() as u32,
            min,
            max,
            cone_axis: if has_cone { axis.as_vec3() } else { Vec3::ZERO },
            cone_sine: if has_cone { (1.0 - cosine * cosine).max(0.0).sqrt() as f32 } else { 1.0 },
            error: 0.0,
            sphere,
            coarser_error: f32::INFINITY,
            coarser_sphere: sphere,
            level: 0,
        }
    }

    pub fn primitive(&self, material: Option<u32>) -> Primitive {
        let points = || self.vertices.iter().map(|v| Vec3::new(v[0], v[1], v[2]));
        Primitive {
            blob: BlobHash::of(&self.bytes()),
            layout: VertexLayout { uv1: !self.second_uvs.is_empty(), ..Self::LAYOUT },
            vertex_count: self.vertices.len() as u32,
            index_count: self.indices.len() as u32,
            coarser_index_count: self.coarser_indices.len() as u32,
            meshlet_count: self.meshlets.len() as u32,
            cuts: Vec::new(),
            finest_level: self.finest_level,
            deformed: None,
            index_format: IndexFormat::U32,
            topology: Topology::Triangles,
            material,
            origin: DVec3::ZERO,
            min: points().fold(Vec3::INFINITY, Vec3::min),
            max: points().fold(Vec3::NEG_INFINITY, Vec3::max),
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = Vec::new();
        for (at, vertex) in self.vertices.iter().enumerate() {
            bytes.extend_from_slice(bytemuck::cast_slice(vertex));
            bytes.extend_from_slice(bytemuck::cast_slice(
                self.second_uvs.get(at..=at).unwrap_or(&[]),
            ));
        }
        let indices = [&self.indices[..], &self.coarser_indices].concat();
        let mut meshlets = self.meshlets.clone();
        if self.is_coarse_first {
            meshlets.sort_by_key(|meshlet| std::cmp::Reverse(meshlet.level));
            for Meshlet { first_index, index_count, .. } in &meshlets {
                let run = *first_index as usize..(first_index + index_count) as usize;
                bytes.extend_from_slice(bytemuck::cast_slice(&indices[run]));
            }
        } else {
            bytes.extend_from_slice(bytemuck::cast_slice(&indices));
        }
        bytes.extend(meshlets.iter().flat_map(Meshlet::to_bytes));
        bytes
    }

    /// All triangles of a level.
    pub fn level(&self, level: u32) -> Vec<u32> {
        let indices = [&self.indices[..], &self.coarser_indices].concat();
        let of_level = self.meshlets.iter().filter(|meshlet| meshlet.level == level);
        let run =
            |of: &Meshlet| of.first_index as usize..(of.first_index + of.index_count) as usize;
        of_level.flat_map(|of| indices[run(of)].to_vec()).collect()
    }

    /// A mesh without the levels that are finer than one.
    pub fn limited_to(&self, level: u32) -> Self {
        let coarsest = self.meshlets.iter().map(|meshlet| meshlet.level).max().unwrap_or(0);
        let finer: u32 = (0..level).map(|finer| self.level(finer).len() as u32).sum();
        let held = self.meshlets.iter().filter(|meshlet| meshlet.level >= level);
        let meshlets = held.map(|of| Meshlet { first_index: of.first_index - finer, ..*of });
        Self {
            vertices: self.vertices.clone(),
            second_uvs: self.second_uvs.clone(),
            indices: self.level(level),
            coarser_indices: (level + 1..=coarsest).flat_map(|of| self.level(of)).collect(),
            meshlets: meshlets.collect(),
            finest_level: level,
            is_coarse_first: true,
        }
    }
}

/// A scene under construction.
#[derive(Default)]
pub struct SceneFixture {
    pub desc: Scene,
    shapes: Vec<MeshFixture>,
    pub textures: Vec<Vec<u8>>,
    /// Radiance from below; as the layout makes it if `None`.
    pub ground: Option<Vec3>,
}

impl SceneFixture {
    pub fn new() -> Self {
        let desc = Scene { sky: Vec3::new(0.3, 0.4, 0.5), ..Scene::default() };
        Self { desc, ..Self::default() }
    }

    /// A mesh of one primitive.
    pub fn mesh(&mut self, shape: &MeshFixture, material: Option<u32>) -> u32 {
        self.desc
            .meshes
            .push(Mesh { primitives: vec![shape.primitive(material)], ..Mesh::default() });
        self.shapes.push(shape.clone());
        self.desc.meshes.len() as u32 - 1
    }

    pub fn material(&mut self, material: Material) -> u32 {
        self.desc.materials.push(material);
        self.desc.materials.len() as u32 - 1
    }

    pub fn node(&mut self, mesh: u32, local: DAffine3) -> u32 {
        self.desc.nodes.push(Node { local, mesh: Some(mesh), ..Node::default() });
        self.desc.nodes.len() as u32 - 1
    }

    pub fn light(&mut self, light: polyptych_scene::Light, local: DAffine3) {
        self.desc.lights.push(light);
        let light = Some(self.desc.lights.len() as u32 - 1);
        self.desc.nodes.push(Node { local, light, ..Node::default() });
    }

    /// A checkerboard with all its levels.
    pub fn checkers(&mut self, side: u32, srgb: bool) -> u32 {
        let mut bytes = Vec::new();
        let mut level_side = side;
        loop {
            for y in 0..level_side {
                for x in 0..level_side {
                    let dark = (x * 8 / level_side + y * 8 / level_side).is_multiple_of(2);
                    bytes.extend(if dark { [40, 90, 160, 255] } else { [230, 200, 120, 255] });
                }
            }
            if level_side == 1 {
                break;
            }
            level_side /= 2;
        }
        let format = if srgb { TextureFormat::Rgba8Srgb } else { TextureFormat::Rgba8Linear };
        self.desc.textures.push(Texture {
            blob: BlobHash::of(&bytes),
            format,
            width: side,
            height: side,
            mip_count: side.ilog2() + 1,
            sampler: Sampler::default(),
        });
        self.textures.push(bytes);
        self.desc.textures.len() as u32 - 1
    }

    /// A grey texture of linear light, with all its levels; clamped at its edges.
    pub fn grey(&mut self, side: u32, light: impl Fn(f64, f64) -> f64) -> u32 {
        let texel = |u, v| {
            let grey = (light(u, v) * 255.0).round() as u8;
            [grey, grey, grey, 255]
        };
        self.picture((side, TextureFormat::Rgba8Linear), texel)
    }

    /// A texture of these texels, with all its levels; clamped at its edges.
    pub fn picture(
        &mut self,
        (side, format): (u32, TextureFormat),
        texel: impl Fn(f64, f64) -> [u8; 4],
    ) -> u32 {
        let (mut bytes, mut level) = (Vec::new(), side);
        while level > 0 {
            let middle = |at: u32| (f64::from(at) + 0.5) / f64::from(level);
            for (y, x) in (0..level).flat_map(|y| (0..level).map(move |x| (y, x))) {
                bytes.extend(texel(middle(x), middle(y)));
            }
            level /= 2;
        }
        self.desc.textures.push(Texture {
            blob: BlobHash::of(&bytes),
            format,
            width: side,
            height: side,
            mip_count: side.ilog2() + 1,
            sampler: Sampler { wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp, ..Sampler::default() },
        });
        self.textures.push(bytes);
        self.desc.textures.len() as u32 - 1
    }

    pub fn build(&self) -> GpuScene {
        self.build_with(&NodeTraits::of_file(self.desc.nodes.len()))
    }

    pub fn build_with(&self, traits: &NodeTraits) -> GpuScene {
        self.build_on(gpu(), traits, |builder| builder)
    }

    /// Builds it on a GPU, with a builder that was set up so.
    pub fn build_on(
        &self,
        gpu: &Gpu,
        traits: &NodeTraits,
        set_up: fn(SceneBuilder) -> SceneBuilder,
    ) -> GpuScene {
        let mut layout = SceneLayout::with_traits(self.desc.clone(), traits, &|| false).unwrap();
        if let Some(ground) = self.ground {
            layout = layout.with_ground(ground);
        }
        let mut builder = set_up(SceneBuilder::of(gpu, Arc::new(layout)).unwrap());
        for (index, bytes) in self.textures.iter().enumerate() {
            builder.upload_texture(gpu, index, bytes).unwrap();
        }
        for (mesh, shape) in self.shapes.iter().enumerate() {
            builder.upload_primitive(gpu, mesh, 0, &shape.bytes()).unwrap();
        }
        builder.finish(gpu).unwrap()
    }
}

/// A camera at `eye` that looks at `at`, with a canvas of the given size and a vertical field of
/// 60°.
pub fn look(eye: DVec3, at: DVec3, canvas: [u32; 2]) -> ViewDesc {
    let z = (eye - at).normalize();
    let x = DVec3::Y.cross(z).normalize_or(DVec3::X);
    let f = 1.0 / 30f64.to_radians().tan();
    let aspect = f64::from(canvas[0]) / f64::from(canvas[1]);
    ViewDesc {
        eye_in_world: eye,
        middle_eye_in_world: eye,
        view_from_world: DMat3::from_cols(x, z.cross(x), z).transpose(),
        clip_from_view: DMat4::from_cols(
            DVec4::X * f / aspect,
            DVec4::Y * f,
            -DVec4::W,
            DVec4::Z * 0.05,
        ),
        viewport: [0.0, 0.0, f64::from(canvas[0]), f64::from(canvas[1])],
        scissor: None,
        exposure: 1.0,
        tone: ToneMapper::default(),
        fog: None,
        glow: None,
        ambient_occlusion: None,
        depth_of_field: None,
        subset: SceneSubset::default(),
        allowed_error: AllowedError::NONE,
        has_shadows: true,
    }
}

/// Draws with a renderer of its own.
pub fn draw_sampled(
    scene: &GpuScene,
    size: [u32; 2],
    samples: u32,
    views: &[ViewDesc],
) -> (Vec<[u8; 4]>, DrawStats) {
    draw_on(gpu(), scene, size, samples, views)
}

/// Draws views of a scene that was built on a GPU.
pub fn draw_on(
    gpu: &Gpu,
    scene: &GpuScene,
    size: [u32; 2],
    samples: u32,
    views: &[ViewDesc],
) -> (Vec<[u8; 4]>, DrawStats) {
    let mut renderer = Renderer::new(gpu, samples).unwrap();
    renderer.prepare(gpu, scene);
    let is_linear = views.iter().any(|view| scene.needs_light(view.effects()));
    let mut target = Target::new(gpu, size, samples, is_linear).unwrap();
    let stats = renderer.draw(gpu, scene, &mut target, views).unwrap();
    let pixels = read_pixels(gpu, &target).unwrap();
    (pixels.as_chunks::<4>().0.to_vec(), stats)
}

/// Draws one view, one sample per pixel.
pub fn draw(scene: &GpuScene, size: [u32; 2], view: &ViewDesc) -> Vec<[u8; 4]> {
    draw_sampled(scene, size, 1, std::slice::from_ref(view)).0
}

pub fn pixel(pixels: &[[u8; 4]], size: [u32; 2], x: u32, y: u32) -> [u8; 4] {
    pixels[(y * size[0] + x) as usize]
}

/// Pixels that differ, that differ by more than 1 and by more than 8 levels.
pub fn differences(a: &[[u8; 4]], b: &[[u8; 4]]) -> [usize; 3] {
    assert_eq!(a.len(), b.len());
    let mut counts = [0; 3];
    for (a, b) in a.iter().zip(b) {
        let most = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
        for (count, limit) in counts.iter_mut().zip([0, 1, 8]) {
            *count += usize::from(most > limit);
        }
    }
    counts
}

/// Returns the number of pixels that differ from the first one, the sky at the corner.
pub fn drawn(pixels: &[[u8; 4]]) -> usize {
    pixels.iter().filter(|pixel| **pixel != pixels[0]).count()
}

/// A matt material of one colour.
pub fn matt(r: f32, g: f32, b: f32) -> Material {
    Material { base_color: glam::Vec4::new(r, g, b, 1.0), metallic: 0.0, ..Material::default() }
}
