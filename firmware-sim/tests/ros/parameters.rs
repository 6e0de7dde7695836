//! Parameters of the node: services, and events about changes.

use super::{Answer, CLOUD, Cdr, called, looking_for_a_part, next, part, triggered};
use host_train::dataset::ros::cdr::from_cdr;

/// `rcl_interfaces/ParameterValue`.
type Value = (
    u8,
    bool,
    i64,
    f64,
    String,
    Vec<u8>,
    Vec<bool>,
    Vec<i64>,
    Vec<f64>,
    Vec<String>,
);

fn text(value: &str) -> Value {
    (
        4,
        false,
        0,
        0.0,
        value.into(),
        vec![],
        vec![],
        vec![],
        vec![],
        vec![],
    )
}

fn flag(value: bool) -> Value {
    let (_, _, integer, double, text, a, b, c, d, e) = text("");
    (1, value, integer, double, text, a, b, c, d, e)
}

/// `rcl_interfaces/ParameterEvent`: stamp, node, and new, changed and deleted parameters.
type Event = (i32, u32, String, [Vec<(String, Value)>; 3]);

#[tokio::test(flavor = "multi_thread")]
async fn parameters_are_read_and_set() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let options = ["--on-request", "--view"];
    let (session, _node, _) = looking_for_a_part(folder.path(), &options).await;
    let events = "0/parameter_events/rcl_interfaces::msg::dds_::ParameterEvent_/\
        RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204";
    let events = session.declare_subscriber(events).await;
    let events = events.expect("an open session");
    let key = |service: &str, of: &str, hash: &str| {
        format!("0/reagent/{service}/rcl_interfaces::srv::dds_::{of}_/RIHS01_{hash}")
    };
    let list = key(
        "list_parameters",
        "ListParameters",
        "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    );
    let none: Vec<String> = vec![];
    let listed: [Vec<String>; 2] = called(&session, &list, &(none, 0u64)).await;
    let names = "cloud mode model on_request tf track view weights";
    assert_eq!(listed[0].join(" "), names);
    let get = key(
        "get_parameters",
        "GetParameters",
        "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    );
    let asked = ["mode", "weights", "nothing"].map(str::to_owned).to_vec();
    let values: Vec<Value> = called(&session, &get, &asked).await;
    assert_eq!(values[..2], [text("verify"), text("views")]);
    assert_eq!(values[2].0, 0);
    let set = key(
        "set_parameters",
        "SetParameters",
        "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    );
    let wanted = vec![
        ("mode".to_owned(), text("fast")),
        ("cloud".to_owned(), text("/b")),
    ];
    let results: Vec<(bool, String)> = called(&session, &set, &wanted).await;
    assert_eq!(results[0], (true, String::new()));
    assert!(
        !results[1].0 && results[1].1.contains("another --cloud"),
        "{results:?}"
    );
    // The new mode takes effect: a pose that nothing judged is not given out.
    let cloud = Cdr::cloud(&part());
    session.put(CLOUD, cloud).await.expect("an open session");
    let (success, said) = triggered(&session).await;
    assert!(!success && said.ends_with("pose not judged"), "{said}");
    let values: Vec<Value> = called(&session, &get, &asked).await;
    assert_eq!(values[0], text("fast"));
    // All are set or none, and changes are published.
    let atomically = key(
        "set_parameters_atomically",
        "SetParametersAtomically",
        "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    );
    let set_both = async |mode: &str, on_request: Value| -> (bool, String) {
        let wanted = [("mode", text(mode)), ("on_request", on_request)];
        let wanted = wanted.map(|(name, value)| (name.to_owned(), value));
        called(&session, &atomically, &wanted.to_vec()).await
    };
    let (set, reason) = set_both("polish", text("no")).await;
    assert!(!set && reason == "on_request is a bool", "{reason}");
    let (set, reason) = set_both("verify", flag(true)).await;
    assert!(set, "{reason}");
    // The initial parameters may come first, if they were published during the subscription.
    let changes = async || loop {
        let event = from_cdr::<Answer<Event>>(&next(&events).await);
        let (_, _, node, [new, changed, deleted]) = event.expect("an event").0;
        assert!(node == "/reagent" && deleted.is_empty());
        if new.is_empty() {
            return changed;
        }
        assert!(new.len() == names.split(' ').count() && changed.is_empty());
    };
    for told in [
        vec![("mode", text("fast"))],
        vec![("mode", text("verify")), ("on_request", flag(true))],
    ] {
        let told = told
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value));
        assert_eq!(changes().await, told.collect::<Vec<_>>());
    }
}
