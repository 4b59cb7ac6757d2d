//! SpaceMouse without a browser: input reports of a Linux hidraw file become events of an inbox.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use genmanip_teleop::device::{Device, DeviceEvent, ReportLayout};
use genmanip_workspace::WorkspaceError;

use super::inbox::Inbox;

/// Largest report descriptor that the kernel gives, bytes.
const DESCRIPTOR_BYTES: u64 = 4096;
/// Pause before a device that is gone is looked for again.
const AGAIN: Duration = Duration::from_millis(250);
/// Size of a read, bytes: a hidraw file gives one report per read, and reports are shorter.
const READ_BYTES: usize = 512;

/// A multi-axis controller at a hidraw file, or at a named pipe in its place.
#[derive(Clone, Debug)]
pub struct Hidraw {
    path: PathBuf,
    device: Device,
    layout: ReportLayout,
    /// True for a named pipe, whose reads may give parts of reports or several.
    is_stream: bool,
}

impl Hidraw {
    /// The device at `path`, such as `/dev/hidraw0`. The layout of its reports comes from the HID report descriptor that
    /// the kernel shows under `/sys/class/hidraw`, or from the file `descriptor`.
    ///
    /// # Errors
    /// If there is no such file, the descriptor cannot be read, or the device has none of the six axes.
    pub fn find(path: &Path, descriptor: Option<&Path>) -> Result<Self, WorkspaceError> {
        let unreadable = |error| {
            WorkspaceError::input(format!("cannot open {}", path.display())).because(error).with_hint(
                "connect the SpaceMouse; `ls /sys/class/hidraw/*/device/` lists devices, and your user needs read \
                 access, e.g. by a udev rule",
            )
        };
        let is_stream = fs::metadata(path).map_err(unreadable)?.file_type().is_fifo();
        if !is_stream {
            File::open(path).map_err(unreadable)?;
        }
        let node = Path::new("/sys/class/hidraw").join(path.file_name().unwrap_or_default()).join("device");
        let file = descriptor.map_or_else(|| node.join("report_descriptor"), Path::to_owned);
        let descriptor = read_descriptor(&file).map_err(|error| {
            WorkspaceError::input(format!("cannot read the HID report descriptor {}", file.display()))
                .because(error)
                .with_hint("name a /dev/hidraw file, or a file with the descriptor's bytes by --descriptor")
        })?;
        let layout = ReportLayout::parse(&descriptor).map_err(|error| {
            WorkspaceError::input(format!("{} is no SpaceMouse", path.display()))
                .because(error)
                .with_hint("name the hidraw file of a multi-axis controller; a SpaceMouse may have several files")
        })?;
        let facts = fs::read_to_string(node.join("uevent")).unwrap_or_default();
        let name = facts.lines().find_map(|line| line.strip_prefix("HID_NAME=")).unwrap_or("multi-axis controller");
        let name: String = name.chars().take(100).collect();
        Ok(Self { path: path.to_owned(), device: Device::SpaceMouse { name, descriptor }, layout, is_stream })
    }

    /// Name of the product.
    pub fn name(&self) -> &str {
        match &self.device {
            Device::SpaceMouse { name, .. } => name,
            other => other.kind(),
        }
    }

    /// Passes the device's reports to an inbox, in a thread that ends after `stop`. Once the device is gone, the arm
    /// holds, and the file is opened again until it is back.
    pub fn watch(self, inbox: Arc<Inbox>, stop: Arc<AtomicBool>) {
        std::thread::spawn(move || {
            let mut sequence = 0;
            let mut put = |event| {
                inbox.put(sequence, 0.0, vec![event], Instant::now());
                sequence += 1;
            };
            while !stop.load(Ordering::Relaxed) {
                if let Ok(file) = File::open(&self.path) {
                    put(DeviceEvent::Connected { device: self.device.clone() });
                    self.pass(file, &mut put);
                    put(DeviceEvent::Disconnected);
                }
                std::thread::sleep(AGAIN);
            }
        });
    }

    /// Passes reports until the device is gone.
    fn pass(&self, mut file: impl Read, put: &mut impl FnMut(DeviceEvent)) {
        let (mut buffer, mut left) = ([0; READ_BYTES], Vec::new());
        loop {
            let bytes = match file.read(&mut buffer) {
                Ok(0) | Err(_) => return,
                Ok(count) => &buffer[..count],
            };
            if !self.is_stream {
                put(DeviceEvent::Report { bytes: bytes.to_vec() });
                continue;
            }
            left.extend_from_slice(bytes);
            let mut rest = &left[..];
            while let Some((report, after)) = self.layout.first_report(rest) {
                put(DeviceEvent::Report { bytes: report.to_vec() });
                rest = after;
            }
            left = rest.to_vec();
        }
    }
}

/// Bytes of a descriptor's file. The kernel's files do not say their size.
fn read_descriptor(path: &Path) -> std::io::Result<Vec<u8>> {
    if !fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("it is no file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(DESCRIPTOR_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_teleop::device::SPACE_NAVIGATOR;

    #[test]
    fn reports_are_passed_byte_for_byte_however_they_are_cut() {
        let stream = [1, 0, 0, 0, 0, 0x5e, 1, 2, 0, 0, 0, 0, 0xa2, 0xfe, 3, 1, 0, 1, 9, 0];
        let layout = ReportLayout::parse(SPACE_NAVIGATOR).unwrap();
        let device = Device::SpaceMouse { name: "test".into(), descriptor: SPACE_NAVIGATOR.to_vec() };
        let whole = [&stream[..7], &stream[7..14], &stream[14..17]];
        for size in [1, 2, 3, 7, 20] {
            let mouse =
                Hidraw { path: PathBuf::new(), device: device.clone(), layout: layout.clone(), is_stream: true };
            let mut passed = Vec::new();
            // The last report is not complete.
            let parts = stream.chunks(size).collect::<Vec<_>>();
            mouse.pass(Parts(parts), &mut |event| passed.push(event));
            let expected = whole.map(|report| DeviceEvent::Report { bytes: report.to_vec() });
            assert_eq!(passed, expected, "in parts of {size}");
        }
        let mouse = Hidraw { path: PathBuf::new(), device, layout, is_stream: false };
        let mut passed = Vec::new();
        mouse.pass(Parts(vec![&stream[..7], &stream[14..17]]), &mut |event| passed.push(event));
        assert_eq!(passed.len(), 2, "a hidraw file gives one report per read");
    }

    /// A reader that gives one part per read.
    struct Parts<'a>(Vec<&'a [u8]>);

    impl Read for Parts<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            if self.0.is_empty() {
                return Ok(0);
            }
            let part = self.0.remove(0);
            buffer[..part.len()].copy_from_slice(part);
            Ok(part.len())
        }
    }
}
