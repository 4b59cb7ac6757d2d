//! Images for models and the marks drawn on them.

mod font;
pub mod marks;

/// An 8-bit sRGB image, three bytes per pixel, row-major from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Width (px).
    pub width: u32,
    /// Height (px).
    pub height: u32,
    /// Pixel colours: three bytes (sRGB) per pixel, row by row.
    pub rgb: Vec<u8>,
}

/// Maximum image side that is decoded (px). Bounds memory for hostile files.
pub const MAX_SIDE: u32 = 8192;

/// 8-bit sRGB colour: red, green, blue.
pub type Color = [u8; 3];

/// Colour of labels and outlines.
pub const WHITE: Color = [255, 255, 255];
/// Background colour of labels.
pub const BLACK: Color = [0, 0, 0];

impl RgbImage {
    /// Creates an image of one colour.
    pub fn plain(width: u32, height: u32, color: Color) -> Self {
        Self { width, height, rgb: color.repeat(width as usize * height as usize) }
    }

    /// Creates an image from pixels; `None` if their number does not match the size.
    pub fn new(width: u32, height: u32, rgb: Vec<u8>) -> Option<Self> {
        (rgb.len() == width as usize * height as usize * 3).then_some(Self { width, height, rgb })
    }

    /// Decodes a PNG file; drops the alpha channel.
    ///
    /// # Errors
    /// Fails unless the file is RGB or RGBA with 8 bits and at most [`MAX_SIDE`] pixels per side.
    pub fn of_png(file: &[u8]) -> Result<Self, String> {
        let broken = |error: png::DecodingError| error.to_string();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().map_err(broken)?;
        let (width, height) = (reader.info().width, reader.info().height);
        if width > MAX_SIDE || height > MAX_SIDE {
            return Err(format!("{width} x {height} pixels, expected at most {MAX_SIDE} each way"));
        }
        let mut data = vec![0; reader.output_buffer_size().unwrap_or(0)];
        let info = reader.next_frame(&mut data).map_err(broken)?;
        data.truncate(info.buffer_size());
        let rgb = match (info.color_type, info.bit_depth) {
            (png::ColorType::Rgb, png::BitDepth::Eight) => data,
            (png::ColorType::Rgba, png::BitDepth::Eight) => {
                data.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
            }
            (color, depth) => return Err(format!("{color:?} with {depth:?} bits, expected RGB or RGBA with 8 bits")),
        };
        Self::new(width, height, rgb).ok_or_else(|| "the pixel data is shorter than the image size requires".into())
    }

    /// Encodes the image as PNG.
    ///
    /// # Errors
    /// Fails if the encoder rejects the image, for example if it is empty.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        // Stronger compression took an eighth of an episode's CPU time.
        encoder.set_compression(png::Compression::Fast);
        encoder.write_header()?.write_image_data(&self.rgb)?;
        Ok(bytes)
    }

    /// Scale of labels and lines: 1 for 512x288, proportional to the height of larger images.
    pub fn unit(&self) -> f64 {
        (f64::from(self.height) / 288.0).max(1.0)
    }

    /// Alpha-blends a colour over a pixel; ignores pixels outside the image.
    pub fn blend(&mut self, x: i64, y: i64, color: Color, alpha: f64) {
        if x < 0 || y < 0 || x >= i64::from(self.width) || y >= i64::from(self.height) {
            return;
        }
        let at = (y as usize * self.width as usize + x as usize) * 3;
        for (channel, over) in self.rgb[at..at + 3].iter_mut().zip(color) {
            *channel = (f64::from(*channel) * (1.0 - alpha) + f64::from(over) * alpha).round() as u8;
        }
    }

    /// Fills a rectangle, excluding the second corner.
    pub fn rectangle(&mut self, from: [f64; 2], to: [f64; 2], color: Color, alpha: f64) {
        let whole = |value: f64| value.round() as i64;
        for y in whole(from[1])..whole(to[1]) {
            for x in whole(from[0])..whole(to[0]) {
                self.blend(x, y, color, alpha);
            }
        }
    }

    /// Draws an anti-aliased line with round caps.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width: f64, color: Color) {
        let reach = width / 2.0 + 1.0;
        let low = |a: f64, b: f64| (a.min(b) - reach).floor() as i64;
        let high = |a: f64, b: f64| (a.max(b) + reach).ceil() as i64;
        let segment = [to[0] - from[0], to[1] - from[1]];
        let squared = (segment[0] * segment[0] + segment[1] * segment[1]).max(1e-12);
        for y in low(from[1], to[1])..=high(from[1], to[1]) {
            for x in low(from[0], to[0])..=high(from[0], to[0]) {
                let at = [x as f64 - from[0], y as f64 - from[1]];
                let share = ((at[0] * segment[0] + at[1] * segment[1]) / squared).clamp(0.0, 1.0);
                let distance = (at[0] - share * segment[0]).hypot(at[1] - share * segment[1]);
                let cover = (width / 2.0 + 0.5 - distance).clamp(0.0, 1.0);
                if cover > 0.0 {
                    self.blend(x, y, color, cover);
                }
            }
        }
    }

    /// Fills an anti-aliased disc; centre and radius in pixels.
    pub fn disc(&mut self, center: [f64; 2], radius: f64, color: Color) {
        self.line(center, center, 2.0 * radius, color);
    }

    /// Crops a part of the image and enlarges it by an integer factor with bilinear interpolation.
    ///
    /// The part must lie inside the image; `corner` is its top left pixel.
    #[must_use]
    pub fn cropped(&self, corner: [u32; 2], size: [u32; 2], scale: u32) -> Self {
        let [width, height] = size.map(|side| side * scale);
        let mut part = Self::plain(width, height, BLACK);
        let place = |pixel: u32, start: u32, length: u32| {
            let at = (f64::from(pixel) + 0.5) / f64::from(scale) - 0.5;
            f64::from(start) + at.clamp(0.0, f64::from(length.max(1) - 1))
        };
        for y in 0..height {
            for x in 0..width {
                let (from_x, from_y) = (place(x, corner[0], size[0]), place(y, corner[1], size[1]));
                let color = self.bilinear(from_x, from_y);
                self.put(&mut part, x, y, color);
            }
        }
        part
    }

    fn put(&self, part: &mut Self, x: u32, y: u32, color: [f64; 3]) {
        let at = (y as usize * part.width as usize + x as usize) * 3;
        for (channel, value) in part.rgb[at..at + 3].iter_mut().zip(color) {
            *channel = value.round() as u8;
        }
    }

    /// Bilinear interpolation of the colour at a position (px).
    fn bilinear(&self, x: f64, y: f64) -> [f64; 3] {
        let (left, top) = (x.floor(), y.floor());
        let (right, low) = (x - left, y - top);
        let pixel = |dx: f64, dy: f64| {
            let column = ((left + dx) as usize).min(self.width as usize - 1);
            let row = ((top + dy) as usize).min(self.height as usize - 1);
            let at = (row * self.width as usize + column) * 3;
            [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]].map(f64::from)
        };
        let corners = [
            (pixel(0.0, 0.0), (1.0 - right) * (1.0 - low)),
            (pixel(1.0, 0.0), right * (1.0 - low)),
            (pixel(0.0, 1.0), (1.0 - right) * low),
            (pixel(1.0, 1.0), right * low),
        ];
        let mut color = [0.0; 3];
        for (corner, weight) in corners {
            for (sum, value) in color.iter_mut().zip(corner) {
                *sum += value * weight;
            }
        }
        color
    }
}
