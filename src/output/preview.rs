//! Pictures under way, in a window of the image viewer tev (T. Müller, github.com/Tom94/tev) by its own protocol over TCP.
//!
//! Who renders only leaves finished pixels here; a thread of this room sends them, a few times a second, the newest of each
//! place only, so that a slow viewer never slows a render. A viewer that goes away is missed once, in a warning.

use std::collections::BTreeMap;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use super::{OutputError, Window};

/// How long a viewer may take to answer, or to take a tile, before it counts as gone.
const PATIENCE: Duration = Duration::from_secs(10);

/// Time between two sendings: as often as an eye would notice.
const PAUSE: Duration = Duration::from_millis(100);

const CHANNELS: [&str; 4] = ["R", "G", "B", "A"];

/// A place of the picture, and red, green, blue and alpha of its pixels.
type Tile = (Window, Vec<[f32; 4]>);

/// A connection to a viewer.
#[derive(Debug)]
pub struct Preview {
    shared: Arc<Shared>,
    sender: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    /// Something was left to be sent, or was sent.
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Name and window of the picture under way.
    picture: Option<(String, Window)>,
    /// The viewer has yet to hear of it.
    is_new: bool,
    /// What has to be sent, by place: rows from the top, so that the same order is sent whoever rendered.
    tiles: BTreeMap<(i32, i32), Tile>,
    /// The thread has taken what it is sending.
    sending: bool,
    gone: bool,
    closing: bool,
}

impl State {
    fn is_sent(&self) -> bool {
        self.gone || !(self.sending || self.is_new) && self.tiles.is_empty()
    }
}

impl Shared {
    /// Poisoned only if the other side panicked: what is sent is whole either way.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poison| poison.into_inner())
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).unwrap_or_else(|poison| poison.into_inner())
    }
}

impl Preview {
    /// Connects to the viewer at `host` and `port`.
    ///
    /// *Errors*: [`OutputError::Viewer`], when none is there.
    pub fn connect(host: &str, port: u16) -> Result<Self, OutputError> {
        let absent = |source| OutputError::Viewer { address: format!("{host}:{port}"), source };
        let mut last = std::io::Error::new(std::io::ErrorKind::NotFound, "the host has no address");
        for address in (host, port).to_socket_addrs().map_err(absent)? {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => return Self::over(stream, format!("{host}:{port}")).map_err(absent),
                Err(error) => last = error,
            }
        }
        Err(absent(last))
    }

    fn over(stream: TcpStream, address: String) -> std::io::Result<Self> {
        stream.set_write_timeout(Some(PATIENCE))?;
        stream.set_nodelay(true)?;
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        let client = TevClient::wrap(stream);
        let sender = std::thread::Builder::new().name("tev".into()).spawn(move || send(&own, client, &address))?;
        Ok(Self { shared, sender: Some(sender) })
    }

    /// A picture begins: the viewer shows it black, as large as `window`. What is still to be sent of one before is sent first.
    pub fn begin(&self, name: &str, window: Window) {
        self.finish();
        let mut state = self.shared.lock();
        // The protocol ends names with a zero, and its client would panic at one within.
        state.picture = Some((name.replace('\0', " "), window));
        state.is_new = true;
        drop(state);
        self.shared.changed.notify_all();
    }

    /// Leaves pixels of the picture to be sent: red, green, blue, alpha (linear, premultiplied), row by row over `window`. They
    /// replace what was left for the same place and has not been sent yet.
    pub fn leave(&self, window: Window, pixels: Vec<[f32; 4]>) {
        let mut state = self.shared.lock();
        if state.gone || window.area() == 0 || pixels.len() != window.area() {
            return;
        }
        let first = state.tiles.is_empty();
        state.tiles.insert((window.y, window.x), (window, pixels));
        drop(state);
        if first {
            self.shared.changed.notify_all();
        }
    }

    /// Waits until everything that was left has been sent, or the viewer has gone.
    pub fn finish(&self) {
        let mut state = self.shared.lock();
        while !state.is_sent() {
            state = self.shared.wait(state);
        }
    }

    /// Whether the viewer has gone.
    pub fn is_gone(&self) -> bool {
        self.shared.lock().gone
    }
}

impl Drop for Preview {
    fn drop(&mut self) {
        self.shared.lock().closing = true;
        self.shared.changed.notify_all();
        if let Some(sender) = self.sender.take() {
            // A thread that panicked has nothing more to say.
            let _ = sender.join();
        }
    }
}

/// Sends what is left, until the preview is dropped and all is sent, or the viewer goes away.
fn send(shared: &Shared, mut client: TevClient, address: &str) {
    loop {
        let mut state = shared.lock();
        while state.is_sent() && !state.closing {
            state = shared.wait(state);
        }
        if state.is_sent() {
            return;
        }
        let is_new = std::mem::take(&mut state.is_new);
        let tiles = std::mem::take(&mut state.tiles);
        let picture = state.picture.clone();
        state.sending = true;
        drop(state);

        let result = picture.map_or(Ok(()), |(name, window)| {
            if is_new {
                let (width, height) = (window.width, window.height);
                let packet =
                    PacketCreateImage { image_name: &name, grab_focus: true, width, height, channel_names: &CHANNELS };
                client.send(packet)?;
            }
            tiles.into_values().try_for_each(|(tile, pixels)| update(&mut client, &name, window, tile, &pixels))
        });
        let mut state = shared.lock();
        state.sending = false;
        if let Err(error) = result {
            tracing::warn!("--tev {address}: the viewer has gone ({error}); the render goes on without it");
            state.gone = true;
            state.tiles.clear();
        }
        let (gone, closing) = (state.gone, state.closing);
        drop(state);
        shared.changed.notify_all();
        if gone {
            return;
        }
        if !closing {
            std::thread::sleep(PAUSE);
        }
    }
}

/// Sends one tile, as far as it lies within the picture.
fn update(
    client: &mut TevClient,
    name: &str,
    picture: Window,
    tile: Window,
    pixels: &[[f32; 4]],
) -> std::io::Result<()> {
    let corner = [tile.x.checked_sub(picture.x), tile.y.checked_sub(picture.y)];
    let [Some(x), Some(y)] = corner.map(|offset| offset.and_then(|offset| u32::try_from(offset).ok())) else {
        return Ok(());
    };
    if u64::from(x) + u64::from(tile.width) > picture.width.into()
        || u64::from(y) + u64::from(tile.height) > picture.height.into()
    {
        return Ok(());
    }
    client.send(PacketUpdateImage {
        image_name: name,
        grab_focus: false,
        channel_names: &CHANNELS,
        channel_offsets: &[0, 1, 2, 3],
        channel_strides: &[4; 4],
        x,
        y,
        width: tile.width,
        height: tile.height,
        data: pixels.as_flattened(),
    })
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::net::TcpListener;

    use super::*;

    fn window(x: i32, y: i32, width: u32, height: u32) -> Window {
        Window { x, y, width, height }
    }

    /// A preview and the viewer's end of it.
    fn connected() -> (Preview, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let preview = Preview::connect("127.0.0.1", listener.local_addr().unwrap().port()).unwrap();
        (preview, listener.accept().unwrap().0)
    }

    #[test]
    fn packets_are_as_the_protocol_has_them() {
        let (preview, mut viewer) = connected();
        preview.begin("a", window(-4, 8, 64, 32));
        preview.leave(window(0, 9, 1, 1), vec![[0.5, 0.25, 8.0, 1.0]]);
        // Outside of the picture, and of another size than it says: neither is sent.
        preview.leave(window(60, 8, 2, 1), vec![[1.0; 4]; 2]);
        preview.leave(window(1, 9, 2, 1), vec![[1.0; 4]]);
        preview.finish();
        drop(preview);
        let mut sent = Vec::new();
        viewer.read_to_end(&mut sent).unwrap();
        let int = |value: u32| value.to_le_bytes().to_vec();
        let names = b"R\0G\0B\0A\0".to_vec();
        // tev's Ipc.cpp: length with itself, kind, whether to focus, name; then for a new image its size and channels.
        let create = [vec![4, 1], b"a\0".to_vec(), int(64), int(32), int(4), names.clone()].concat();
        let longs = |values: [u64; 4]| values.map(u64::to_le_bytes).concat();
        let pixel = [0.5f32, 0.25, 8.0, 1.0].map(f32::to_le_bytes).concat();
        let place = [int(4), int(1), int(1), int(1)].concat();
        let update =
            [vec![6, 0], b"a\0".to_vec(), int(4), names, place, longs([0, 1, 2, 3]), longs([4; 4]), pixel].concat();
        let expected: Vec<u8> =
            [create, update].into_iter().flat_map(|packet| [int(packet.len() as u32 + 4), packet].concat()).collect();
        assert_eq!(sent, expected);
    }

    #[test]
    fn a_viewer_that_goes_away_or_does_not_read_holds_nobody_up() {
        let (preview, viewer) = connected();
        drop(viewer);
        preview.begin("a", window(0, 0, 512, 512));
        // The first packets may still find room in the system's buffers.
        for _ in 0..200 {
            preview.leave(window(0, 0, 512, 512), vec![[1.0; 4]; 512 * 512]);
            preview.finish();
            if preview.is_gone() {
                break;
            }
        }
        assert!(preview.is_gone());
        preview.begin("b", window(0, 0, 8, 8));
        preview.leave(window(0, 0, 8, 8), vec![[1.0; 4]; 64]);
        preview.finish();
    }

    #[test]
    fn where_no_viewer_is_the_error_says_what_was_expected() {
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let told = Preview::connect("127.0.0.1", free).unwrap_err().to_string();
        assert!(told.contains(&format!("127.0.0.1:{free}")) && told.contains("expected a running tev"), "{told}");
    }
}
