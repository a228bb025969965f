//! A browser opens the report.
//!
//! If there is no browser, the test is skipped with a message; with `PHASEWARP_BROWSER=required`,
//! which `.ci/run` sets after the installation, it fails. `make browser` installs one.

use super::{album, look_at};
use crate::support::{directory, of_case, on_results, skipped, text_of};
use std::path::{Path, PathBuf};
use std::process::Command;

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let places: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let all = names.iter().flat_map(|name| places.iter().map(move |p| p.join(name)));
    all.into_iter().find(|p| p.is_file())
}

/// Opens a page in a window of this width, with `more` options. Returns what the browser prints.
fn open(browser: &Path, page: &Path, width: u32, more: &[String]) -> Result<String, String> {
    let profile = directory();
    let mut command = Command::new(browser);
    command
        .args([
            "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
            "--no-first-run",
        ])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--disable-default-apps",
        ])
        .args([
            "--disable-domain-reliability",
            "--disable-client-side-phishing-detection",
            "--hide-scrollbars",
        ])
        // The browser itself makes no requests either.
        .arg("--host-resolver-rules=MAP * ~NOTFOUND")
        .arg("--disable-features=OptimizationHints,MediaRouter,Translate")
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},2400"))
        .args(more)
        .arg(format!("file://{}", page.display()))
        .env("HOME", profile.path());
    let output = command.output().map_err(|e| format!("{}: {e}", browser.display()))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The network requests of pages in the browser's log, without those of the browser itself.
fn requests(log: &Path) -> Vec<String> {
    let text = text_of(log).unwrap();
    let beyond = |line: &&str| {
        line.contains("\"initiator\":\"")
            && !line.contains("\"initiator\":\"not an origin\"")
            && ["http:", "https:", "ws:", "wss:"]
                .iter()
                .any(|scheme| line.contains(&format!("\"url\":\"{scheme}")))
    };
    text.lines().filter(beyond).map(str::to_owned).collect()
}

#[test]
fn a_browser_opens_the_report() {
    let Some(browser) = browser() else {
        let why = "no chromium, chromium-browser or google-chrome; `make browser` installs one";
        return skipped("PHASEWARP_BROWSER", "tests/cli/pictures/browser.rs", why);
    };
    let place = directory();
    let marked =
        "title=\"</title><script>document.title='x'</script><img src=http://127.0.0.1:9/a.png>\"";
    let settings = ["axis.0.x.cells=40", "axis.0.v.cells=38", "output.fields_every=0.25", marked];
    let job = of_case("run", "example1.toml").set(&settings);
    job.solve(place.path()).unwrap();
    on_results("report", place.path()).succeed().unwrap();
    let page = place.path().join("report.html");
    let pictures = album(place.path()).pictures.len();
    assert!(pictures >= 6);

    // The page is not blank and makes no requests.
    let (shot, log) = (place.path().join("shot.png"), place.path().join("net.json"));
    let log_to = |log: &Path| format!("--log-net-log={}", log.display());
    let options = [format!("--screenshot={}", shot.display()), log_to(&log)];
    open(&browser, &page, 1200, &options).unwrap();
    let (width, height) = look_at(&shot).unwrap();
    assert_eq!((width, height), (1200, 2400));
    assert_eq!(requests(&log), Vec::<String>::new());
    // Control: the request of a page is found.
    let requesting = place.path().join("asking.html");
    std::fs::write(&requesting, "<img src=http://127.0.0.1:9/a.png>").unwrap();
    open(&browser, &requesting, 600, &[log_to(&log), "--dump-dom".to_owned()]).unwrap();
    assert!(requests(&log).iter().any(|url| url.contains("127.0.0.1:9")));

    // Every picture is placed and not cut, and no content overflows sideways. A script measures
    // this in a copy of the page, as the page itself forbids scripts.
    let text = text_of(&page).unwrap();
    let policy = text.lines().find(|l| l.contains("Content-Security-Policy")).unwrap();
    // Each button of the track shows its own picture alone.
    let script = "<script>const wide=e=>e.getBoundingClientRect().width>250;\
        const shown=e=>getComputedStyle(e).visibility==='visible';\
        const steps=[...document.querySelectorAll('.track input')].map(e=>{e.checked=true;\
        const all=[...document.querySelectorAll('.track img')].filter(shown);\
        return all.length===1&&all[0]===e.nextElementSibling&&wide(all[0])?'+':'-'}).join('');\
        document.body.innerHTML=\
        'pictures='+[...document.querySelectorAll('figure svg')].filter(wide).length+\
        ' cut='+[...document.querySelectorAll('figure')].filter(e=>e.scrollWidth>e.clientWidth+1)\
        .length+' marked='+document.querySelectorAll('img:not(.track *)').length+' times='+steps+\
        ' over='+(document.documentElement.scrollWidth-\
        document.documentElement.clientWidth)</script></body>";
    let measured = place.path().join("measured.html");
    std::fs::write(&measured, text.replace(policy, "").replace("</body>", script)).unwrap();
    for width in [1200, 420] {
        let printed = open(&browser, &measured, width, &["--dump-dom".to_owned()]).unwrap();
        let expected = format!("pictures={pictures} cut=0 marked=0 times=+++++ over=0");
        assert!(printed.contains(&expected), "{width}: {expected} expected, {printed}");
    }
}
