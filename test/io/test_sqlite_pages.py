"""Rows of SQLite's pages, against what SQLite itself reads."""

import sqlite3

import numpy as np
import pytest

from lrtrav_ros.io.sqlite_pages import message_rows


@pytest.mark.parametrize("page_size", [512, 4096, 65536])
def test_rows_are_those_that_sqlite_reads(page_size, tmp_path):
    path = tmp_path / "bag.db3"
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA page_size={page_size}")
    connection.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    rng = np.random.default_rng(page_size)
    for i, n_bytes in enumerate([0, 1, page_size - 60, *range(page_size - 40, page_size - 20), 5 * page_size, 70_001]):
        row = (i % 3, int(rng.integers(2 ** (2 * i + 1))) - 5, rng.bytes(n_bytes))
        connection.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", row)
    connection.execute("INSERT INTO messages VALUES(9000000000000000000, 1, 2, x'03')")
    connection.commit()
    rows = connection.execute("SELECT * FROM messages ORDER BY id").fetchall()
    connection.close()
    assert [tuple(row) for row in message_rows(path)] == rows
    assert len(rows) == 26


def test_links_in_circles_come_to_an_end(tmp_path):
    path = tmp_path / "bag.db3"
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA page_size=512")
    connection.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    connection.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 2, ?)", [(bytes(3000),)] * 50)
    connection.commit()
    connection.close()
    data = bytearray(path.read_bytes())
    for at in range(512, len(data), 512):
        if data[at] == 0:  # a page that a row is continued on
            data[at : at + 4] = (at // 512 + 1).to_bytes(4, "big")
    path.write_bytes(data)
    assert sum(len(row.data) for row in message_rows(path)) <= len(data)
