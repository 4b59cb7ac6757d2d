//! `genmanip calibrate board`: an image of a calibration board to print.

use genmanip_core::glam::DVec2;
use genmanip_real::boards::{BORDER_MM, Charuco, Layout, TagGrid, svg};
use genmanip_real::calibrate::Board;
use genmanip_render::encode;
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{WorkspaceError, documents};
use serde_json::json;

use crate::args::CalibrateBoardArguments;

/// Resolution of a PNG, pixels per metre: 600 dpi.
const PIXELS_PER_M: u32 = 23_622;
/// Maximum side of a board as PNG, m.
const MAX_PNG_M: f64 = 0.6;

/// Writes the image of a board, and its description for `genmanip calibrate`.
pub fn write(arguments: &CalibrateBoardArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let CalibrateBoardArguments { columns, rows, first_id, .. } = *arguments;
    let (square_m, tag_m) = (arguments.square_mm / 1e3, arguments.tag_mm / 1e3);
    let board = match arguments.pattern.as_str() {
        "tags" => Board::Tags(TagGrid {
            columns,
            rows,
            tag_m,
            gap_m: (arguments.square_mm - arguments.tag_mm) / 1e3,
            first_id,
        }),
        _ => Board::Charuco(Charuco { columns, rows, square_m, tag_m, first_id }),
    };
    let layout = match board.layout() {
        Some(Ok(layout)) => layout,
        Some(Err(reason)) => return Err(Failed::new("no such board").hint(reason)),
        None => return Err(Failed::new("no such board")),
    };
    let caption = format!(
        "{} {columns} x {rows}, {} mm, tags {} mm (tag36h11, ids {first_id} to {}). Print at 100 % and measure.",
        arguments.pattern,
        arguments.square_mm,
        arguments.tag_mm,
        first_id as usize + layout.tags.len() - 1,
    );
    let (bytes, size_mm) = match arguments.out.extension().and_then(|ending| ending.to_str()) {
        Some("svg") => page(&layout, &arguments.page, &caption)?,
        Some("png") => picture(&layout)?,
        _ => return Err(Failed::misused("unknown ending").hint("--out FILE.svg or FILE.png")),
    };
    let description = arguments.out.with_extension("json");
    let text = serde_json::to_string_pretty(&board).map_err(|error| WorkspaceError::broken("no JSON", error))? + "\n";
    documents::write_file(&arguments.out, &bytes)?;
    documents::write_file(&description, text.as_bytes())?;
    let size = size_mm.to_array().map(|mm| (10.0 * mm).round() / 10.0);
    let data = json!({
        "board": board,
        "image": arguments.out,
        "image_mm": size,
        "pattern_mm": (layout.size_m * 1e3).to_array().map(|mm| (10.0 * mm).round() / 10.0),
        "corners": layout.corners.len(),
    });
    let [width, height] = size;
    let (image, description) = (arguments.out.display(), description.display());
    printer.data(
        &data,
        &format!(
            "wrote {image}, {width} x {height} mm: print it at 100 %, glue it to something flat, and measure a square\n\
             wrote {description}: the `board` of a file of views, with the measured size\n"
        ),
    );
    Ok(ExitStatus::Done)
}

fn page(layout: &Layout, name: &str, caption: &str) -> Result<(Vec<u8>, DVec2), Failed> {
    let upright = match name {
        "a3" => DVec2::new(297.0, 420.0),
        "letter" => DVec2::new(215.9, 279.4),
        _ => DVec2::new(210.0, 297.0),
    };
    // Portrait and landscape.
    let pages = [upright, DVec2::new(upright.y, upright.x)];
    let drawn = pages.into_iter().find_map(|page| Some((svg(layout, page, caption)?.into_bytes(), page)));
    drawn.ok_or_else(|| {
        let DVec2 { x, y } = layout.size_m * 1e3;
        Failed::new(format!("{x:.0} x {y:.0} mm with {BORDER_MM} mm around them do not fit on {name}"))
            .hint("smaller squares or fewer of them, a larger --page, or FILE.png")
    })
}

fn picture(layout: &Layout) -> Result<(Vec<u8>, DVec2), Failed> {
    if layout.size_m.max_element() > MAX_PNG_M {
        return Err(Failed::new(format!("a PNG of more than {MAX_PNG_M} m is too large")).hint("--out FILE.svg"));
    }
    let grey = layout.raster(1.0 / f64::from(PIXELS_PER_M), BORDER_MM * 1e-3);
    let [width, height] = [grey.width() as u32, grey.height() as u32];
    let bytes = encode::png_print(width, height, grey.values(), PIXELS_PER_M)
        .map_err(|error| WorkspaceError::broken("the picture cannot be encoded", error))?;
    Ok((bytes, layout.size_m * 1e3 + 2.0 * BORDER_MM))
}
