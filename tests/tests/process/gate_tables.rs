//! Variable tables that a station keeps for every browser.

use serde_json::json;

use crate::common::gate::{Visitor, add_user, station};
use crate::common::site::Site;

#[test]
fn tables_are_kept_for_every_user_and_over_a_restart() {
    let site = Site::new();
    add_user(&site, "a.users", "rita", "read", "rita-password");
    add_user(&site, "a.users", "anna", "operate", "anna-password");
    let keys = "rights = \"operate\"\nusers = \"a.users\"";
    let (running, page, _) = station(&site, "gate-tables", keys);
    let table = json!({ "name": "pumps", "lines": "MW 20 // speed\nDB10.recipe" });
    let stranger = Visitor::at(page);
    assert_eq!((stranger.post("/api/tables", &table).status, stranger.get("/api/tables").status), (401, 401));
    let rita = Visitor::as_user(page, "rita", "rita-password");
    assert_eq!(rita.get("/api/tables").json(), json!({}));
    assert_eq!(rita.post("/api/tables", &table).json(), json!({ "pumps": "MW 20 // speed\nDB10.recipe" }));
    // A form of another site.
    let foreign =
        rita.post_with("/api/tables", "Origin: http://elsewhere\r\nContent-Type: application/json\r\n", &table);
    assert_eq!(foreign.status, 403);
    for wrong in
        [json!({}), json!({ "name": " ", "lines": "MW 20" }), json!({ "name": "x", "lines": "M1.0\n".repeat(501) })]
    {
        assert!([400, 422].contains(&rita.post("/api/tables", &wrong).status), "{wrong}");
    }
    let audit = std::fs::read_to_string(site.path("gate-tables.audit")).expect("a log");
    assert!(audit.contains("\"user\":\"rita\"") && audit.contains("table \\\"pumps\\\""), "{audit}");
    assert_eq!(running.interrupt().code(), Some(0));

    let running = site.run("station.toml").until_run();
    running.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    let anna = Visitor::as_user(page, "anna", "anna-password");
    assert_eq!(anna.get("/api/tables").json()["pumps"], "MW 20 // speed\nDB10.recipe");
    assert_eq!(anna.post("/api/tables", &json!({ "name": "pumps" })).json(), json!({}));
    assert_eq!(running.interrupt().code(), Some(0));
}

/// Where there is no folder for them the page works, and says so.
#[test]
fn without_a_folder_nothing_is_kept() {
    let site = Site::new();
    site.write("gate-no-folder.gate", "a file");
    let (running, page, _) = station(&site, "gate-no-folder", "");
    let visitor = Visitor::at(page);
    assert_eq!(visitor.get("/api/tables").json(), json!({}));
    let refused = visitor.post("/api/tables", &json!({ "name": "pumps", "lines": "MW 20" }));
    assert!(refused.status == 422 && refused.body.contains("no folder for tables"), "{refused:?}");
    let ended = running.interrupt();
    assert!(ended.err.contains("no variable table can be kept"), "{ended:?}");
}
