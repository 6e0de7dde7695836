#!/usr/bin/env python3
"""Bags of ROS 2 that others write, and what `host-train` makes of them: rosbags writes folders with metadata, plain and zstd, and
SQLite; the library of MCAP writes lz4, checksums, and files without chunks and without a summary.

    pip install rosbags mcap pamoja-ros2 eclipse-zenoh xxhash numpy
    tests/bags.py target/release/host-train
    tests/bags.py --write tests/fixtures/bags
"""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from ros2 import STORE, TYPES, cloud_message, header, shape, turned

CLOUD = "sensor_msgs/msg/PointCloud2"
LABEL = "std_msgs/msg/Header"
LAYOUTS = [("<f4", [0, 1, 2], 0, 1), (">f4", [2, 0, 1], 4, 1), ("<f8", [1, 2, 0], 3, 2), (">f8", [0, 2, 1], 8, 4)]
SECOND = 10**9


def truth(number):
    """Where the part is in message `number`: turning by 3 degrees and moving by 20 mm from one to the next."""
    return turned(0.05 * number, np.array([1.0, 2.0, 3.0])), np.array([0.02 * number, -0.01 * number, 0.5])


def messages(rng, count, points):
    """Clouds ten times a second, each in another layout, with a label before it."""
    for number in range(count):
        rotation, shift = truth(number)
        seen = shape(rng, points) @ rotation.T + shift
        time = 100 * SECOND + number * SECOND // 10
        yield "/camera/label", LABEL, time, header(f"part {number}", number)
        yield "/camera/points", CLOUD, time + 1000, cloud_message(seen, number, *LAYOUTS[number % 4])


def lidar(rng, count, points):
    """The same, and another topic of clouds."""
    yield "/lidar/points", CLOUD, 100 * SECOND, cloud_message(shape(rng, points), 0, *LAYOUTS[0])
    yield from messages(rng, count, points)


def by_rosbags(folder, of, storage=StoragePlugin.MCAP, mode=None):
    writer = Writer(folder, version=9, storage_plugin=storage)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for topic, kind, time, message in of:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(topics[topic], time, STORE.serialize_cdr(message, kind))
    return folder


def by_mcap(path, of, **options):
    with open(path, "wb") as file:
        writer = McapWriter(file, chunk_size=4096, **options)
        writer.start(profile="ros2", library="")
        topics = {}
        for topic, kind, time, message in of:
            if topic not in topics:
                schema = writer.register_schema(kind, "ros2msg", b"")
                topics[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(topics[topic], time, bytes(STORE.serialize_cdr(message, kind)), time)
        writer.finish()
    return path


def bags(folder):
    """A bag of every kind, of eight clouds."""
    rng = np.random.default_rng(5)
    of = lambda: messages(rng, 8, 900)
    yield by_rosbags(folder / "plain", of())
    yield by_rosbags(folder / "zstd", of(), mode=CompressionMode.STORAGE)
    yield by_mcap(folder / "lz4.mcap", of(), compression=CompressionType.LZ4)
    yield by_mcap(folder / "zstd.mcap", of(), compression=CompressionType.ZSTD)
    yield by_mcap(folder / "unchunked.mcap", of(), use_chunking=False)
    nothing = {"use_statistics": False, "use_summary_offsets": False, "repeat_channels": False, "repeat_schemas": False}
    yield by_mcap(folder / "no_summary.mcap", of(), compression=CompressionType.NONE, **nothing)
    # As a recorder divides a long one.
    split = by_rosbags(folder / "split", of())
    [whole] = split.glob("*.mcap")
    whole.unlink()
    for part in range(11):
        one = [m for n, m in enumerate(messages(np.random.default_rng(part), 11, 900)) if n // 2 == part]
        by_mcap(split / f"split_{part}.mcap", one)
    yield split


def run(program, folder, *arguments):
    done = subprocess.run([program, *map(str, arguments)], cwd=folder, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def check_pose(rows, number):
    """That the part is where it was put."""
    pose = np.array(rows)
    rotation, shift = truth(number)
    turn = pose[:, :3] @ rotation
    degrees = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    error = np.linalg.norm(pose[:, :3] @ shift + pose[:, 3])
    assert degrees < 2 and error < 0.005, (number, degrees, error)


def check(program):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        np.savetxt(folder / "part.xyz", shape(np.random.default_rng(1), 1500), fmt="%.6f")
        for bag in bags(folder):
            status, said, errors = run(program, folder, "track", "part.xyz", bag)
            assert status == 0, errors
            lines = [json.loads(line) for line in said.splitlines()]
            expected = 11 if bag.name == "split" else 8
            assert [line["message"] for line in lines] == list(range(expected)), said
            for number, line in enumerate(lines):
                assert line["stamp"] == {"sec": number, "nanosec": 5}, line
                assert line["state"] == ("tracked" if number else "found"), line
                check_pose(line["target_from_source"], number)
            status, _, errors = run(program, folder, "register", bag, "part.xyz", "--message", "0.65s", "--json", "pose.json")
            pose = json.loads((folder / "pose.json").read_text())
            assert status == 0 and "message 7 of /camera/points, stamped 7.000000005" in errors, errors
            check_pose(pose["target_from_source"], 7)
            print(f"{bag.name}: {expected} clouds followed, one registered")
        refused = [
            (by_rosbags(folder / "sqlite", messages(np.random.default_rng(2), 2, 50), StoragePlugin.SQLITE3), "ros2 bag convert"),
            (by_rosbags(folder / "file", messages(np.random.default_rng(2), 2, 50), mode=CompressionMode.FILE), "zstd -d"),
            (by_rosbags(folder / "each", messages(np.random.default_rng(2), 2, 50), mode=CompressionMode.MESSAGE), "ros2 bag convert"),
        ]
        for bag, advice in refused:
            status, _, errors = run(program, folder, "register", bag, "part.xyz")
            assert status == 1 and advice in errors and errors.count("\n") == 1, errors
            print(errors.strip())


def write(folder):
    """Small ones that are kept."""
    rng = np.random.default_rng(3)
    np.savetxt(folder / "part.xyz", shape(rng, 600), fmt="%.4f")
    with tempfile.TemporaryDirectory() as name:
        bag = by_rosbags(pathlib.Path(name, "two_topics"), lidar(rng, 5, 120))
        shutil.copy(bag / "two_topics.mcap", folder)
    by_mcap(folder / "lz4.mcap", messages(rng, 6, 200), compression=CompressionType.LZ4)
    by_mcap(folder / "zstd.mcap", messages(rng, 2, 100), compression=CompressionType.ZSTD)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--write", folder]:
            write(pathlib.Path(folder))
        case [program]:
            check(pathlib.Path(program).resolve())
