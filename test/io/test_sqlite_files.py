"""Databases of ROS 2 that are hostile or damaged."""

import shutil
import sqlite3
import time
from contextlib import closing

import pytest
from recorder import Recorder, random_image, record_pairs, storage_file

from lrtrav_ros.io.bag_reader import BagReader

TOPICS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);
INSERT INTO topics VALUES(1, '/a', 'std_msgs/msg/Empty', 'cdr', '');
"""
MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
ENDLESS = "WITH RECURSIVE r(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM r) SELECT id"


def database(tmp_path, script):
    path = tmp_path / "bag.db3"
    connection = sqlite3.connect(path)
    connection.executescript(script)
    connection.close()
    return path


def contents(path):
    """Return messages and problems."""
    with BagReader(path) as reader:
        return [(message.topic, message.time_ns, message.data) for message in reader.messages()], reader.problems


@pytest.mark.parametrize(
    "script",
    [
        f"{TOPICS} CREATE VIEW messages AS {ENDLESS}, 1 AS topic_id, id AS timestamp, x'00' AS data FROM r;",
        f"{MESSAGES} CREATE VIEW topics AS {ENDLESS}, 'a' AS name, 'b' AS type FROM r;",
        f"{TOPICS} {MESSAGES} CREATE VIEW message_definitions AS {ENDLESS} AS topic_type, "
        "1 AS encoded_message_definition FROM r;",
        f"{TOPICS} CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data);",
        f"{TOPICS} CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)));"
        "INSERT INTO messages(topic_id, timestamp) VALUES(1, 5);",
        TOPICS,
    ],
)
def test_only_stored_tables_are_read(script, tmp_path):
    messages, problems = contents(database(tmp_path, script))
    assert messages == []
    assert "damaged or not finished (it" in problems[0]


@pytest.mark.parametrize("time", ["-5", "NULL", "'x'", "x'00'", "1.5", "9e999", str(2**63 - 1), str(-(2**63))])
def test_a_message_without_a_time_is_missed(time, tmp_path):
    path = database(
        tmp_path,
        f"{TOPICS} {MESSAGES} INSERT INTO messages(topic_id, timestamp, data) "
        f"VALUES(1, {time}, x'00'), (1, 7, x'0001');",
    )
    messages, problems = contents(path)
    assert messages == [("/a", 7, b"\0\1")]
    assert problems[-1] == f"{path}: 1 of the 2 messages on /a that are listed cannot be read"


@pytest.mark.parametrize("data", ["'text'", "5", "NULL"])
def test_a_message_without_data_is_missed(data, tmp_path):
    path = database(
        tmp_path,
        f"{TOPICS} {MESSAGES} INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 6, {data}), (1, 7, x'0001');",
    )
    assert contents(path) == (
        [("/a", 7, b"\0\1")],
        [f"{path}: 1 of the 2 messages on /a that are listed cannot be read"],
    )


def test_topics_and_types_that_are_none_are_told(tmp_path):
    path = database(
        tmp_path,
        f"{TOPICS} {MESSAGES} INSERT INTO topics VALUES(2, '/a', 'std_msgs/msg/String', 'cdr', '[{{a: ');"
        "INSERT INTO topics VALUES(3, CAST(x'ff' AS TEXT), NULL, 'cdr', 5);"
        "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 6, x'00'), (2, 7, x'00'), (9, 8, x'00');",
    )
    messages, problems = contents(path)
    assert messages == [("/a", 6, b"\0")]
    assert f"{path}: 1 messages are of no topic that is known" in problems
    assert (
        f"{path}: message on /a at 7 ns skipped (its type is std_msgs/msg/String, not std_msgs/msg/Empty as before)"
        in problems
    )
    assert any("quality of service cannot be read" in problem for problem in problems)


def test_a_topic_whose_number_is_a_query_is_none(tmp_path):
    query = "1) UNION SELECT 1, 5, x''00'' --"
    script = f"{TOPICS} {MESSAGES} CREATE TABLE other AS SELECT CAST(id AS TEXT) AS id, name, type FROM topics;"
    script += f"INSERT INTO other VALUES('{query}', '/b', 'std_msgs/msg/Empty'); DROP TABLE topics;"
    path = database(tmp_path, script + "ALTER TABLE other RENAME TO topics;")
    with BagReader(path) as reader:
        assert reader.topics == {}


@pytest.mark.parametrize("name", [b"caf\xe9 ?#%41.db3", b"x" * 245 + b".db3"])
def test_any_name_will_do(name, tmp_path):
    recorder = Recorder(tmp_path / "bag", "sqlite3")
    recorder.infos()
    recorder.close()
    path = tmp_path / name.decode(errors="surrogateescape")
    shutil.copy(storage_file(recorder.path), path)
    messages, problems = contents(path)
    assert (len(messages), problems) == (2, [])


def test_of_a_large_file_that_is_cut_off_half_is_read(tmp_path):
    recorder = Recorder(tmp_path / "bag", "sqlite3")
    record_pairs(recorder, 300)
    recorder.close()
    path = storage_file(recorder.path)
    data = path.read_bytes()
    assert len(data) > 2_000_000
    path.write_bytes(data[: len(data) // 2])
    messages, problems = contents(path)
    images = {random_image(i).tobytes() for i in range(300)}
    assert sum(any(data.endswith(image) for image in images) for _, _, data in messages[2:]) == len(messages) - 2
    assert 250 < len(messages) < 310
    assert "damaged" in problems[0]


def write_ahead(tmp_path, *, checkpoint=True):
    """Return a database as a recorder leaves it that was killed: the second message is in its log alone."""
    connection = sqlite3.connect(tmp_path / "recording.db3", isolation_level=None)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.executescript(f"{TOPICS} {MESSAGES} INSERT INTO messages VALUES(1, 1, 6, x'00');")
    if checkpoint:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.execute("INSERT INTO messages VALUES(2, 1, 7, x'01')")
    path = tmp_path / "killed" / "my drive.db3"
    path.parent.mkdir()
    for suffix in ("", "-wal"):
        shutil.copy(tmp_path / f"recording.db3{suffix}", f"{path}{suffix}")
    connection.close()
    return path


@pytest.mark.parametrize("checkpoint", [True, False])
def test_messages_in_the_log_of_a_recorder_that_did_not_end_are_told(checkpoint, tmp_path):
    path = write_ahead(tmp_path, checkpoint=checkpoint)
    for bag in (path, path.parent):
        messages, problems = contents(bag)
        assert messages == ([("/a", 6, b"\0")] if checkpoint else [])
        assert problems[0] == (
            f"{path}: its recorder did not end: messages in {path}-wal are not read; move them into the database "
            f"first, by sqlite3 '{path}' 'PRAGMA wal_checkpoint'"
        )
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA wal_checkpoint")
    assert contents(path) == ([("/a", 6, b"\0"), ("/a", 7, b"\1")], [])


def test_an_empty_log_is_none(tmp_path):
    path = database(tmp_path, f"{TOPICS} {MESSAGES}")
    path.with_name(f"{path.name}-wal").touch()
    assert contents(path) == ([], [])


def test_nested_text_of_qualities_of_service_takes_no_time(tmp_path):
    deep = "[" * 60_000
    path = database(tmp_path, f"{TOPICS} {MESSAGES} UPDATE topics SET offered_qos_profiles = '{deep}';")
    start = time.process_time()
    assert contents(path)[1] == [f"{path}: /a: its quality of service cannot be read (ValueError)"]
    assert time.process_time() - start < 2
