#!/usr/bin/env python3
"""`firmware-sim ros` against what is not ours: messages by rosbags, keys by pamoja-ros2, the network by eclipse-zenoh.

    pip install rosbags pamoja-ros2 eclipse-zenoh xxhash numpy
    tests/ros2.py target/release/firmware-sim
"""

import json
import os
import pathlib
import queue
import socket
import subprocess
import sys
import tempfile

import numpy as np
import xxhash
import zenoh
import zenoh.ext
from pamoja import ros2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
PATIENCE = 60.0


def define_service(name, request, response):
    """Adds the type of a service, which has a request, a response and an event of both (REP 2016), as rosbags has messages only."""
    ends = [f"{name}_{end}" for end in ["Request", "Response", "Event"]]
    for end, definition in zip(ends, [request, response]):
        message = end.replace("/srv/", "/msg/")
        STORE.register(get_types_from_msg(definition, message))
        STORE.fielddefs[end] = STORE.fielddefs[message]
    one = lambda end: (Nodetype.SEQUENCE, ((Nodetype.NAME, end), 1))
    info = (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo")
    STORE.fielddefs[ends[2]] = ([], [("info", info), ("request", one(ends[0])), ("response", one(ends[1]))])
    fields = ["request_message", "response_message", "event_message"]
    STORE.fielddefs[name] = ([], [(field, (Nodetype.NAME, end)) for field, end in zip(fields, ends)])


# What `.msg` calls char is uint8 in IDL, which counts.
constants, fields = STORE.fielddefs["service_msgs/msg/ServiceEventInfo"]
fields = [(name, (Nodetype.ARRAY, ((Nodetype.BASE, ("uint8", 0)), 16)) if name == "client_gid" else kind) for name, kind in fields]
STORE.fielddefs["service_msgs/msg/ServiceEventInfo"] = (constants, fields)
TRIGGER = "std_srvs/srv/Trigger"
define_service(TRIGGER, "", "bool success\nstring message")
define_service("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b", "int64 sum")
PARAMETERS = "rcl_interfaces/srv/"
define_service(f"{PARAMETERS}DescribeParameters", "string[] names", "rcl_interfaces/ParameterDescriptor[] descriptors")
define_service(f"{PARAMETERS}GetParameterTypes", "string[] names", "uint8[] types")
define_service(f"{PARAMETERS}GetParameters", "string[] names", "rcl_interfaces/ParameterValue[] values")
define_service(f"{PARAMETERS}ListParameters", "string[] prefixes\nuint64 depth", "rcl_interfaces/ListParametersResult result")
define_service(f"{PARAMETERS}SetParameters", "rcl_interfaces/Parameter[] parameters", "rcl_interfaces/SetParametersResult[] results")
define_service(f"{PARAMETERS}SetParametersAtomically", "rcl_interfaces/Parameter[] parameters", "rcl_interfaces/SetParametersResult result")
SERVICES = {
    "register": TRIGGER,
    "describe_parameters": f"{PARAMETERS}DescribeParameters",
    "get_parameter_types": f"{PARAMETERS}GetParameterTypes",
    "get_parameters": f"{PARAMETERS}GetParameters",
    "list_parameters": f"{PARAMETERS}ListParameters",
    "set_parameters": f"{PARAMETERS}SetParameters",
    "set_parameters_atomically": f"{PARAMETERS}SetParametersAtomically",
}


def type_hash(name):
    """As rosbags computes it from the definitions."""
    return STORE.hash_rihs01(name)


# As the design document of rmw_zenoh shows it.
ADDED = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
assert type_hash("example_interfaces/srv/AddTwoInts") == ADDED


def key(topic, name):
    """As pamoja-ros2 assembles it."""
    built = ros2.entity_key(0, topic, name, type_hash(name))
    assert built, (topic, name)
    return built


def header(frame, stamp):
    time = TYPES["builtin_interfaces/msg/Time"](sec=stamp, nanosec=5)
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def cloud_message(points, stamp, dtype, order, gap, height):
    """A PointCloud2 with fields in `order`, `gap` bytes around them, and a NaN point."""
    points = np.vstack([points, [[np.nan] * 3]])
    points = points[: len(points) // height * height]
    kind = np.dtype(dtype)
    step = 2 * gap + 3 * kind.itemsize
    data = np.full((len(points), step), 0xAB, np.uint8)
    field = TYPES["sensor_msgs/msg/PointField"]
    fields = []
    for place, axis in enumerate(order):
        offset = gap + place * kind.itemsize
        column = np.ascontiguousarray(points[:, axis].astype(kind)).view(np.uint8)
        data[:, offset : offset + kind.itemsize] = column.reshape(len(points), -1)
        datatype = 7 if kind.itemsize == 4 else 8
        fields.append(field(name="xyz"[axis], offset=offset, datatype=datatype, count=1))
    width = len(points) // height
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header=header("camera", stamp),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=kind.byteorder == ">",
        point_step=step,
        row_step=width * step,
        data=data.reshape(-1),
        is_dense=False,
    )


def shape(rng, count):
    """Points of three faces of a box, which has no symmetry."""
    uv = rng.random((count, 2))
    face = rng.integers(0, 3, count)
    points = np.zeros((count, 3))
    for axis in range(3):
        here = face == axis
        others = [k for k in range(3) if k != axis]
        points[np.ix_(here, others)] = uv[here]
    return (points - 0.4) * [0.3, 0.2, 0.1]


def turned(angle, axis):
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def rotation_of(q):
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def call(session, service, number, **request):
    """Asks a service as rmw_zenoh does, and checks that the answer is for this client and number."""
    name = SERVICES[service]
    service = f"/lab/reagent/{service}"
    asked, answered = [f"{name}_{end}".replace("/srv/", "/msg/") for end in ["Request", "Response"]]
    payload = STORE.serialize_cdr(TYPES[asked](**(request or {"structure_needs_at_least_one_member": 0})), asked)
    client = bytes(range(16))
    sender = number.to_bytes(8, "little") + bytes(8) + b"\x10" + client
    replies = session.get(
        key(service, name),
        payload=bytes(payload),
        attachment=sender,
        target=zenoh.QueryTarget.ALL_COMPLETE,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=PATIENCE,
    )
    [reply] = [reply.ok for reply in replies]
    attachment = reply.attachment.to_bytes()
    assert attachment[:8] == sender[:8] and attachment[16:] == sender[16:], attachment
    assert str(reply.key_expr) == key(service, name)
    return STORE.deserialize_cdr(reply.payload.to_bytes(), answered)


def text(value):
    """A string as a parameter's value."""
    nothing = {"bool_value": False, "integer_value": 0, "double_value": 0.0, "byte_array_value": np.zeros(0, np.uint8)}
    nothing |= {"bool_array_value": np.zeros(0, bool), "integer_array_value": np.zeros(0, np.int64)}
    nothing |= {"double_array_value": np.zeros(0), "string_array_value": []}
    return TYPES["rcl_interfaces/msg/ParameterValue"](type=4, string_value=value, **nothing)


def check_parameters(session, events):
    """Lists, reads, describes and sets them as `ros2 param` does, and hears what was set as rqt does."""
    names = call(session, "list_parameters", 1, prefixes=[], depth=0).result.names
    assert names == ["cloud", "mode", "model", "on_request", "tf", "track", "view", "weights"], names
    types = call(session, "get_parameter_types", 2, names=names).types
    assert types.tolist() == [4, 4, 4, 1, 4, 1, 1, 4], types
    read = lambda: call(session, "get_parameters", 3, names=names).values
    values = [value.string_value if value.type == 4 else value.bool_value for value in read()]
    assert values[:2] == ["/camera/points", "verify"] and values[3:] == [False, "part", False, False, "reagent"], values
    described = call(session, "describe_parameters", 4, names=names).descriptors
    assert [d.name for d in described if not d.read_only] == ["mode", "on_request"], described
    assert [d.type for d in described] == types.tolist()
    one = lambda name, value: TYPES["rcl_interfaces/msg/Parameter"](name=name, value=text(value))
    wanted = [one("mode", "polish"), one("mode", "slow"), one("weights", "compact"), one("mode", "verify")]
    results = call(session, "set_parameters", 5, parameters=wanted).results
    assert [result.successful for result in results] == [True, False, False, True], results
    assert "polish" in results[1].reason and "--weights" in results[2].reason, results
    wanted = [one("mode", "polish"), one("mode", "slow")]
    result = call(session, "set_parameters_atomically", 6, parameters=wanted).result
    assert not result.successful and "slow" in result.reason, result
    result = call(session, "set_parameters_atomically", 7, parameters=[one("mode", "verify")]).result
    assert result.successful and not result.reason, result
    told = lambda parameters: [(parameter.name, parameter.value.string_value) for parameter in parameters]
    for new, changed in [(names, []), ([], ["polish", "verify"]), ([], ["verify"])]:
        event, _, _ = events.next()
        assert event.node == "/lab/reagent" and event.stamp.sec > 1_700_000_000, event
        assert [name for name, _ in told(event.new_parameters)] == new, event
        assert told(event.changed_parameters) == [("mode", value) for value in changed], event
        assert not event.deleted_parameters, event
    print(f"parameters: {dict(zip(names, values))}; {results[2].reason}")


class Topic:
    """Messages of a topic, as a subscription hears them."""

    def __init__(self, session, topic, name):
        self.name, self.samples = name, queue.Queue()
        self.subscriber = session.declare_subscriber(key(topic, name), self.samples.put)

    def next(self):
        sample = self.samples.get(timeout=PATIENCE)
        payload = sample.payload.to_bytes()
        assert payload[:4] == b"\0\1\0\0", payload[:4]
        attachment = sample.attachment.to_bytes()
        assert len(attachment) == 33 and attachment[16] == 16, attachment
        number = int.from_bytes(attachment[:8], "little")
        return STORE.deserialize_cdr(payload, self.name), number, attachment[17:]


class Latched(Topic):
    """The same of a subscription that is transient local, as rmw_zenoh has it."""

    def __init__(self, session, topic, name):
        self.name, self.samples = name, queue.Queue()
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        self.subscriber = zenoh.ext.declare_advanced_subscriber(
            session, key(topic, name), self.samples.put, history=history, subscriber_detection=True
        )


def main(program):
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as folder, socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        probe.close()
        model = pathlib.Path(folder, "part.xyz")
        np.savetxt(model, shape(rng, 1500), fmt="%.6f")
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        with zenoh.open(config) as session:
            play(program, session, endpoint, model, rng)


def play(program, session, endpoint, model, rng):
    tokens = queue.Queue()
    graph = session.liveliness().declare_subscriber("@ros2_lv/0/**", tokens.put, history=True)
    pose_topic = Topic(session, "/lab/reagent/pose", "geometry_msgs/msg/PoseStamped")
    with_covariance = Topic(
        session, "/lab/reagent/pose_with_covariance", "geometry_msgs/msg/PoseWithCovarianceStamped"
    )
    transforms = Topic(session, "/tf", "tf2_msgs/msg/TFMessage")
    diagnostics = Topic(session, "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    events = Topic(session, "/parameter_events", "rcl_interfaces/msg/ParameterEvent")
    cloud_type = "sensor_msgs/msg/PointCloud2"
    clouds = session.declare_publisher(key("/camera/points", cloud_type))
    early = Latched(session, "/lab/reagent/model", cloud_type)
    arguments = ["ros", "--model", model, "--cloud", "/camera/points", "--namespace", "/lab", "--connect", endpoint, "--tf", "part"]
    environment = os.environ | {"ROS_DOMAIN_ID": "0"}
    node = subprocess.Popen([program, *arguments], stdout=subprocess.PIPE, text=True, env=environment)
    try:
        said = node.stdout.readline()
        assert "hears /camera/points" in said, said
        found = {}
        while len(found) < 15:
            parts = str(tokens.get(timeout=PATIENCE).key_expr).split("/")
            assert parts[:2] == ["@ros2_lv", "0"] and parts[6:9] == ["%", "%lab", "reagent"], parts
            found["/".join(parts[5:6] + parts[9:])] = "/".join(parts)
        expected = {"NN"}
        for kind, topic, name, qos in [
            ("MP", "/lab/reagent/pose", pose_topic.name, "::,10:,:,:,,"),
            ("MP", "/lab/reagent/pose_with_covariance", with_covariance.name, "::,10:,:,:,,"),
            ("MP", "/diagnostics", diagnostics.name, "::,10:,:,:,,"),
            ("MP", "/tf", transforms.name, "::,100:,:,:,,"),
            ("MP", "/lab/reagent/model", cloud_type, ":1:,1:,:,:,,"),
            ("MP", "/parameter_events", events.name, "::,1000:,:,:,,"),
            ("MS", "/camera/points", cloud_type, "2::,5:,:,:,,"),
            *(("SS", f"/lab/reagent/{service}", name, "::,10:,:,:,," if service == "register" else "::,1000:,:,:,,") for service, name in SERVICES.items()),
        ]:
            dds, mangled = ros2.dds_type_name(name), ros2.percent_mangle(topic)
            expected.add(f"{kind}/{mangled}/{dds}/{type_hash(name)}/{qos}")
        assert set(found) == expected, set(found) ^ expected

        # Whoever is there before the node has the model, and whoever comes after it; both have it once.
        late = Latched(session, "/lab/reagent/model", cloud_type)
        expected = np.loadtxt(model)
        for latched in [early, late]:
            shown, number, _ = latched.next()
            assert number == 1 and shown.header.frame_id == "part" and shown.is_dense, shown.header
            assert np.allclose(shown.data.view("<f4").reshape(-1, 3), expected)

        early_answer = call(session, "register", 1)
        assert not early_answer.success and "/camera/points" in early_answer.message, early_answer

        check_parameters(session, events)

        def put(message):
            payload = STORE.serialize_cdr(message, cloud_type)
            clouds.put(bytes(payload), attachment=b"\0" * 16 + b"\x10" + b"\0" * 16)

        layouts = [
            ("<f4", [0, 1, 2], 0, 1),
            (">f4", [2, 0, 1], 4, 1),
            ("<f8", [1, 2, 0], 3, 2),
            (">f8", [0, 2, 1], 8, 4),
        ]
        gids = set()
        for number, layout in enumerate(layouts, 1):
            rotation = turned(0.2, rng.normal(size=3))
            shift = np.array([0.02, -0.03, 0.05 * number])
            seen = shape(rng, 1201) @ rotation.T + shift
            put(cloud_message(seen, number, *layout))
            told, _, _ = diagnostics.next()
            status = told.status[0]
            assert (told.header.stamp.sec, status.level) == (number, 0), status
            assert status.name == "lab/reagent: registration" and status.message == "converged"
            stamped, sequence, gid = pose_topic.next()
            gids.add(gid)
            assert sequence == number and stamped.header == header("camera", number), stamped.header
            position = stamped.pose.position
            error = np.array([position.x, position.y, position.z]) - shift
            turn = rotation_of(stamped.pose.orientation) @ rotation.T
            degrees = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
            assert np.linalg.norm(error) < 0.005 and degrees < 2, (error, degrees)
            uncertain, _, _ = with_covariance.next()
            assert uncertain.pose.pose == stamped.pose
            moved = transforms.next()[0].transforms[0]
            assert (moved.header, moved.child_frame_id) == (stamped.header, "part")
            assert moved.transform.rotation == stamped.pose.orientation
            assert moved.transform.translation.x == position.x
            covariance = uncertain.pose.covariance.reshape(6, 6)
            assert np.allclose(covariance, covariance.T) and np.linalg.eigvalsh(covariance)[0] > 0
            values = {pair.key: pair.value for pair in status.values}
            print(f"{layout[0]}: {1e3 * np.linalg.norm(error):.2f} mm, {degrees:.2f} degrees, {values}")
        # Once more for who asks, and for all.
        answer = call(session, "register", 2)
        assert answer.success, answer
        said = json.loads(answer.message)
        assert said["header"] == {"stamp": {"sec": 4, "nanosec": 5}, "frame_id": "camera"} and said["probability"] > 0.9, said
        assert said["pose"]["position"] == [position.x, position.y, position.z], said
        again, sequence, _ = pose_topic.next()
        assert sequence == 5 and again == stamped
        diagnostics.next(), with_covariance.next(), transforms.next()
        print(f"a service says {answer.message}")
        [gid] = gids
        [token] = [token for end, token in found.items() if end.startswith("MP/%lab%reagent%pose/")]
        assert gid == xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")

        # What has no pose has a reason, and the node goes on.
        flat = cloud_message(shape(rng, 50), 9, "<f4", [0, 1, 2], 0, 1)
        flat.fields.pop()
        put(flat)
        told, _, _ = diagnostics.next()
        assert told.status[0].level == 2 and '"z"' in told.status[0].message, told
        clouds.put(b"nothing")
        told, _, _ = diagnostics.next()
        assert told.status[0].level == 2 and "CDR" in told.status[0].message, told
        put(cloud_message(rng.normal(size=(600, 3)), 11, "<f4", [0, 1, 2], 0, 1))
        told, _, _ = diagnostics.next()
        assert told.header.stamp.sec == 11 and told.status[0].level == 1, told
        print(f"what fits nothing: {told.status[0].message}")
        assert pose_topic.samples.empty()
        assert early.samples.empty() and late.samples.empty()
    finally:
        node.terminate()
        assert node.wait(PATIENCE) == 0
    gone = set()
    while len(gone) < len(found):
        sample = tokens.get(timeout=PATIENCE)
        assert sample.kind == zenoh.SampleKind.DELETE, sample
        gone.add(str(sample.key_expr))
    assert gone == set(found.values())
    print("keys, tokens, attachments, messages and services are those that others expect")


if __name__ == "__main__":
    main(sys.argv[1])
