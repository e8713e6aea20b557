//! The HTTP options of commands that run a manager.

use std::io::Cursor;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};

use anyhow::{Context, bail};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use polyptych_client::fit_bounds;
use polyptych_manager::http::{HttpOptions, PORT_DEFAULT};

/// Quality of pictures as JPEG, of 100: they are looked at, not measured.
const JPEG_QUALITY: u8 = 85;

/// An address to listen on, as an argument: `HOST:PORT`, or `HOST` with the usual port.
pub(super) fn address(text: &str) -> Result<String, String> {
    super::address::address_with(text, PORT_DEFAULT, 0)
}

/// Listens for HTTP; where other machines reach it only if that was said.
pub(super) fn bind(at: &str, may_be_open: bool, hosts: Vec<String>) -> anyhow::Result<HttpOptions> {
    let resolved = at.to_socket_addrs();
    let addresses: Vec<SocketAddr> =
        resolved.with_context(|| format!("--http {at}: an address is HOST:PORT"))?.collect();
    if let Some(open) = addresses.iter().find(|address| !address.ip().is_loopback())
        && !may_be_open
    {
        bail!(
            "--http {at}: {open} can be reached from other machines, and without keys nothing is \
             encrypted; make keys with polyptych keys WALL.toml and say --keys FOLDER, or use \
             127.0.0.1, or say --insecure on a network that you trust"
        );
    }
    let listener = TcpListener::bind(&addresses[..])
        .map_err(|error| anyhow::anyhow!("--http {at}: cannot listen there: {error}"))?;
    Ok(HttpOptions { listener, hosts, encode_jpeg, fit_camera: fit_bounds })
}

/// The address of the page.
pub(super) fn url(address: SocketAddr, is_encrypted: bool) -> String {
    format!("{}://{address}/", if is_encrypted { "https" } else { "http" })
}

fn encode_jpeg(rgb: &[u8], width: u32, height: u32) -> Result<Vec<u8>, String> {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .write_image(rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(|error| error.to_string())?;
    Ok(bytes.into_inner())
}
