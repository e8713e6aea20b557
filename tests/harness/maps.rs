//! Files of walls as other programs write them: PFM, OBJ, Bourke meshes, PNG with a gamma, and
//! MPCDI archives. Written from the formats alone, without any of the code that reads them, and
//! without the libraries that it uses.

use std::fmt::Write;

/// A float map: values by column and row from the upper left; 2 or 3 of them are written.
pub fn pfm(
    size: [u32; 2],
    components: usize,
    is_little: bool,
    value: impl Fn(u32, u32) -> [f32; 3],
) -> Vec<u8> {
    let scale = if is_little { "-1.000000" } else { "1.0" };
    let mut out = format!("PF\n{} {}\n{scale}\n", size[0], size[1]).into_bytes();
    for y in (0..size[1]).rev() {
        for number in (0..size[0]).flat_map(|x| value(x, y).into_iter().take(components)) {
            out.extend(if is_little { number.to_le_bytes() } else { number.to_be_bytes() });
        }
    }
    out
}

/// A grid of quadrilaterals: position and UV (v up) of each corner by its place, 0 to 1, from the
/// upper left.
pub fn obj(cells: [u32; 2], corner: impl Fn(f64, f64) -> ([f64; 3], [f64; 2])) -> String {
    let mut text = String::from("# a screen\nmtllib none.mtl\no screen\n");
    for y in 0..=cells[1] {
        for x in 0..=cells[0] {
            let at = [f64::from(x) / f64::from(cells[0]), f64::from(y) / f64::from(cells[1])];
            let ([px, py, pz], [u, v]) = corner(at[0], at[1]);
            let _ = write!(text, "v {px} {py} {pz}\nvt {u} {v}\n");
        }
    }
    let across = cells[0] + 1;
    for y in 0..cells[1] {
        for x in 0..cells[0] {
            let a = y * across + x + 1;
            let corners = [a, a + across, a + across + 1, a + 1];
            let words = corners.map(|corner| format!("{corner}/{corner}"));
            let _ = writeln!(text, "f {}", words.join(" "));
        }
    }
    text
}

/// Paul Bourke's mesh: x, y, u, v and intensity of each node by its column and row.
pub fn bourke(nodes: [u32; 2], node: impl Fn(u32, u32) -> [f64; 5]) -> String {
    let mut text = format!("2\n{} {}\n", nodes[0], nodes[1]);
    for y in 0..nodes[1] {
        for x in 0..nodes[0] {
            let words = node(x, y).map(|number| number.to_string());
            let _ = writeln!(text, "{}", words.join(" "));
        }
    }
    text
}

/// The contents of a PNG.
#[derive(Clone, Debug)]
pub struct Png<'a> {
    pub size: [u32; 2],
    /// PNG's own number: 0 grey, 2 colour, 4 grey and alpha, 6 colour and alpha.
    pub color: u8,
    /// 8 or 16.
    pub bits: u8,
    /// The gAMA chunk: 100,000 times the exponent.
    pub gamma: Option<u32>,
    pub texels: &'a [u16],
}

/// A PNG whose pixels are stored, not packed.
pub fn png(picture: &Png) -> Vec<u8> {
    let Png { size, color, bits, gamma, texels } = picture;
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8], body: &[u8]| {
        out.extend((body.len() as u32).to_be_bytes());
        let both = [kind, body].concat();
        out.extend(&both);
        out.extend(crc32(&both).to_be_bytes());
    };
    let sides = size.map(u32::to_be_bytes).concat();
    chunk(b"IHDR", &[&sides[..], &[*bits, *color, 0, 0, 0]].concat());
    if let Some(gamma) = gamma {
        chunk(b"gAMA", &gamma.to_be_bytes());
    }
    let components = [1, 0, 3, 0, 2, 0, 4][usize::from(*color)];
    let mut raw = Vec::new();
    for row in texels.chunks(size[0] as usize * components) {
        raw.push(0);
        for texel in row {
            match bits {
                16 => raw.extend(texel.to_be_bytes()),
                _ => raw.push(*texel as u8),
            }
        }
    }
    let zlib = [&[0x78, 0x01][..], &stored(&raw), &adler32(&raw).to_be_bytes()].concat();
    chunk(b"IDAT", &zlib);
    chunk(b"IEND", &[]);
    out
}

/// An entry of an archive.
#[derive(Clone, Debug)]
pub struct Entry {
    pub name: String,
    /// The bytes that lie in the archive.
    pub packed: Vec<u8>,
    /// 0 stored, 8 deflated.
    pub method: u16,
    /// The number of unpacked bytes that its head states, and their sum.
    pub bytes: u32,
    pub crc: u32,
}

impl Entry {
    pub fn new(name: &str, bytes: &[u8]) -> Self {
        let (packed, name) = (bytes.to_vec(), name.to_owned());
        Self { name, packed, method: 0, bytes: bytes.len() as u32, crc: crc32(bytes) }
    }

    /// An entry whose bytes are a stream of deflate.
    pub fn deflated(name: &str, bytes: &[u8]) -> Self {
        Self { packed: stored(bytes), method: 8, ..Self::new(name, bytes) }
    }
}

/// A zip archive.
pub fn zip(entries: &[Entry]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut central = Vec::new();
    for entry in entries {
        let at = out.len() as u32;
        let common = [
            &[20, 0, 0, 0][..],
            &entry.method.to_le_bytes(),
            &[0, 0, 0x21, 0x28],
            &entry.crc.to_le_bytes(),
            &(entry.packed.len() as u32).to_le_bytes(),
            &entry.bytes.to_le_bytes(),
            &(entry.name.len() as u16).to_le_bytes(),
            &[0, 0],
        ]
        .concat();
        out.extend([b"PK\x03\x04", &common[..], entry.name.as_bytes(), &entry.packed].concat());
        central.extend([b"PK\x01\x02\x14\0", &common[..], &[0; 10], &at.to_le_bytes()].concat());
        central.extend(entry.name.as_bytes());
    }
    let count = (entries.len() as u16).to_le_bytes();
    let (at, length) = ((out.len() as u32).to_le_bytes(), (central.len() as u32).to_le_bytes());
    out.extend(central);
    out.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count, &length, &at, &[0, 0]].concat());
    out
}

/// One projector of an archive.
#[derive(Clone, Debug)]
pub struct Region {
    pub id: String,
    pub size: [u32; 2],
    /// x, y, xsize, ysize.
    pub part: [f64; 4],
    /// Yaw, pitch, roll, right, left, up, down.
    pub frustum: Option<[f64; 7]>,
    pub warp: Vec<u8>,
    pub unit: Option<String>,
    pub origin: Option<String>,
    pub alpha: Option<(Vec<u8>, f64)>,
    pub beta: Option<(Vec<u8>, f64)>,
}

/// The text and the files of an archive; names as some programs have them, with capitals.
pub fn mpcdi_entries(profile: &str, buffer: [u32; 2], regions: &[Region]) -> Vec<Entry> {
    let mut entries = Vec::new();
    let mut sets = String::new();
    let mut display = String::new();
    for region in regions {
        let id = &region.id;
        let [x, y, xsize, ysize] = region.part;
        let [width, height] = region.size;
        let _ = write!(
            display,
            "<region id=\"{id}\" x=\"{x}\" y=\"{y}\" xsize=\"{xsize}\" ysize=\"{ysize}\" \
             xResolution=\"{width}\" yResolution=\"{height}\">"
        );
        if let Some(numbers) = region.frustum {
            let names = ["yaw", "pitch", "roll", "rightAngle", "leftAngle", "upAngle", "downAngle"];
            let tags = names.iter().zip(numbers);
            let tags: Vec<_> = tags.map(|(name, n)| format!("<{name}>{n}</{name}>")).collect();
            let _ = write!(display, "<frustum>{}</frustum>", tags.concat());
        }
        display.push_str("</region>");
        let _ = write!(sets, "<fileset region=\"{id}\">");
        for (tag, mask) in [("alphaMap", &region.alpha), ("betaMap", &region.beta)] {
            let Some((bytes, gamma)) = mask else { continue };
            let _ = write!(
                sets,
                "<{tag}><path>{id}/{tag}.png</path><componentDepth>1</componentDepth>\
                 <bitDepth>8</bitDepth><gammaEmbedded>{gamma}</gammaEmbedded></{tag}>"
            );
            entries.push(Entry::new(&format!("{id}/{tag}.png"), bytes));
        }
        let tag = |name: &str, text: &Option<String>| {
            text.as_ref().map_or_else(String::new, |text| format!("<{name}>{text}</{name}>"))
        };
        let unit = tag("geometricUnit", &region.unit);
        let origin = tag("originOf3DData", &region.origin);
        let _ = write!(
            sets,
            "<geometryWarpFile><path>{id}/warp.pfm</path><interpolation>linear</interpolation>\
             {unit}{origin}</geometryWarpFile></fileset>"
        );
        entries.push(Entry::deflated(&format!("{id}/warp.pfm"), &region.warp));
    }
    let [width, height] = buffer;
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<MPCDI profile=\"{profile}\" level=\"1\" \
         version=\"1.0\" date=\"2013-08-01 12:00:00\"><display><buffer id=\"all\" \
         Xresolution=\"{width}\" Yresolution=\"{height}\">{display}</buffer></display>\
         <files>{sets}</files></MPCDI>\n"
    );
    entries.insert(0, Entry::new("mpcdi.xml", text.as_bytes()));
    entries
}

/// RFC 1951, 3.2.4: bytes in blocks that are not packed.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let blocks = bytes.chunks(65535);
    let last = blocks.len().saturating_sub(1);
    for (i, block) in blocks.enumerate() {
        let length = block.len() as u16;
        out.push(u8::from(i == last));
        out.extend([length.to_le_bytes(), (!length).to_le_bytes()].concat());
        out.extend(block);
    }
    if bytes.is_empty() { vec![1, 0, 0, 0xff, 0xff] } else { out }
}

/// ISO 3309, as in PNG and zip.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        let shift = |c: u32| if c & 1 == 1 { 0xedb8_8320 ^ c >> 1 } else { c >> 1 };
        (0..8).fold(crc ^ u32::from(*byte), |c, _| shift(c))
    };
    !bytes.iter().fold(u32::MAX, step)
}

/// RFC 1950.
fn adler32(bytes: &[u8]) -> u32 {
    let step = |(a, b): (u32, u32), byte: &u8| {
        let a = (a + u32::from(*byte)) % 65521;
        (a, (b + a) % 65521)
    };
    let (a, b) = bytes.iter().fold((1, 0), step);
    b << 16 | a
}
