//! Binary masks: which pixels of an image show an object.

/// Pixel mask of one object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Image width (px).
    pub width: u32,
    /// Image height (px).
    pub height: u32,
    /// True for pixels of the object, row-major from the top left.
    pub pixels: Vec<bool>,
}

impl Mask {
    /// True if there is exactly one value per pixel.
    pub fn is_whole(&self) -> bool {
        self.pixels.len() as u64 == u64::from(self.width) * u64::from(self.height)
    }

    /// Indices of the object's pixels, ascending.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.pixels.iter().enumerate().filter(|(_, inside)| **inside).map(|(index, _)| index)
    }

    /// Dilates the mask by one pixel (8-neighbourhood).
    #[must_use]
    pub fn dilated(&self) -> Self {
        let mut dilated = self.clone();
        let (width, height) = (self.width as i64, self.height as i64);
        for index in self.indices() {
            let (x, y) = (index as i64 % width, index as i64 / width);
            for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let (x, y) = (x + dx, y + dy);
                if (0..width).contains(&x) && (0..height).contains(&y) {
                    dilated.pixels[(y * width + x) as usize] = true;
                }
            }
        }
        dilated
    }

    /// Mask of the pixels with a given label in a label image.
    pub fn of_label<T: PartialEq>(width: u32, height: u32, labels: &[T], label: &T) -> Self {
        Self { width, height, pixels: labels.iter().map(|other| other == label).collect() }
    }

    /// Number of pixels of the object.
    pub fn area(&self) -> usize {
        self.pixels.iter().filter(|is_inside| **is_inside).count()
    }

    /// Intersection over union in [0, 1]; 0 for two empty masks and for masks of different sizes.
    ///
    /// ```
    /// use genmanip_agent::segmentation::Mask;
    /// let mask = |pixels: [bool; 4]| Mask { width: 2, height: 2, pixels: pixels.to_vec() };
    /// let iou = mask([true, true, false, false]).iou(&mask([false, true, true, true]));
    /// assert!((iou - 0.25).abs() < 1e-12);
    /// ```
    pub fn iou(&self, other: &Self) -> f64 {
        if (self.width, self.height) != (other.width, other.height) {
            return 0.0;
        }
        let count = |test: fn(bool, bool) -> bool| {
            self.pixels.iter().zip(&other.pixels).filter(|(one, other)| test(**one, **other)).count()
        };
        count(|one, other| one && other) as f64 / count(|one, other| one || other).max(1) as f64
    }

    /// Pixel of the object nearest to the centroid; `None` if the mask is empty.
    pub fn middle(&self) -> Option<usize> {
        let width = self.width.max(1) as usize;
        let place = |index: usize| [(index % width) as f64, (index / width) as f64];
        let area = self.area() as f64;
        let mean = |axis: usize| self.indices().map(|index| place(index)[axis]).sum::<f64>() / area;
        let [x, y] = [mean(0), mean(1)];
        let distance = |index: &usize| (place(*index)[0] - x).hypot(place(*index)[1] - y);
        self.indices().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Bounding box: first and last column and row, `[[x, x], [y, y]]`; `None` if the mask is empty.
    pub fn bounds(&self) -> Option<[[u32; 2]; 2]> {
        let width = self.width.max(1) as usize;
        let mut bounds: Option<[[u32; 2]; 2]> = None;
        for (index, _) in self.pixels.iter().enumerate().filter(|(_, is_inside)| **is_inside) {
            let (x, y) = ((index % width) as u32, (index / width) as u32);
            let [columns, rows] = bounds.get_or_insert([[x, x], [y, y]]);
            *columns = [columns[0].min(x), columns[1].max(x)];
            *rows = [rows[0].min(y), rows[1].max(y)];
        }
        bounds
    }
}
