//! The page in a real browser.
#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

use std::fs;
use std::process::Command;

/// Script added to the page: filters, sorts and resets, each including the layout of the result, and writes the times.
const MEASURE: &str = r##"<script>
const timed = (name, act) => {
  const since = performance.now();
  act();
  document.body.getBoundingClientRect();
  return [name, performance.now() - since];
};
const errors = [];
addEventListener("error", (event) => errors.push(event.message));
addEventListener("load", () => {
  document.body.getBoundingClientRect();
  const shown = performance.now();
  const words = document.querySelector("#episodes input");
  const type = (text) => { words.value = text; words.dispatchEvent(new Event("input")); };
  const took = [
    ["shown", shown],
    timed("first filter", () => type("slipped")),
    timed("second filter", () => type("missed")),
    timed("sorting", () => document.querySelector("#episodes th button").click()),
    timed("clearing", () => type("")),
  ];
  const rows = document.querySelectorAll("#episodes tbody tr").length;
  const cause = document.querySelector("a[data-outcome]");
  took.push(timed("rows of a cause", () => cause.click()));
  const outcomes = new Set(Array.from(document.querySelectorAll("#episodes tbody tr"), (row) => row.cells[3].textContent));
  const said = document.createElement("pre");
  said.id = "measured";
  said.textContent = JSON.stringify({ took: Object.fromEntries(took), rows, cause: cause.textContent, outcomes: [...outcomes], errors });
  document.body.append(said);
});
</script>"##;

/// Measurements of a headless browser on a page: milliseconds by name, rows in the page, errors.
pub fn measure(browser: &str, page: &str) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    fs::write(&path, page.replacen("</body>", &format!("{MEASURE}</body>"), 1)).unwrap();
    let profile = format!("--user-data-dir={}", folder.path().join("profile").display());
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,800", "--timeout=60000", &profile])
        .args(["--dump-dom", &format!("file://{}", path.display())])
        .output()
        .unwrap();
    let dom = String::from_utf8(output.stdout).unwrap();
    let said = dom.split("<pre id=\"measured\">").nth(1).and_then(|rest| rest.split("</pre>").next());
    let said = said.unwrap_or_else(|| panic!("nothing measured: {}", String::from_utf8_lossy(&output.stderr)));
    serde_json::from_str(said).unwrap()
}
