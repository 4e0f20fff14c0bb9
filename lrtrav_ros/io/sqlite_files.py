"""Databases of ROS 2 (.db3), whole or damaged. The format has no checksums."""

from __future__ import annotations

import shlex
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from lrtrav_ros.io.bag_records import Contents, RawMessage, Report, qos_profiles
from lrtrav_ros.io.sqlite_pages import message_rows

_TABLES = ("topics", "messages", "message_definitions")
_TOPICS = "FROM topics WHERE typeof(id) = 'integer'"  # their numbers become part of a query
_STEPS = 1_000_000  # of SQLite's machine, after which it is asked whether to go on
_STEPS_PER_BYTE = 50  # a message, which takes more than 10 bytes, costs about 20


class SqliteFile:
    """A database that is read by its indices.

    Parameters
    ----------
    path : Path
        The file.
    report : callable
        Is called with what is damaged, when it is come upon.

    Attributes
    ----------
    contents : Contents
        What it holds.

    Raises
    ------
    ValueError, sqlite3.Error
        If it is damaged, or no recording.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self._report = report
        self._report_log(path)
        self._database = _Database(path)
        self.contents = Contents()
        try:
            self._topics = self._database.topics()
            self._fill_contents()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time."""
        wanted = [number for number, (topic, _) in self._topics.items() if topic in topics]
        choice = f" AND topic_id IN ({', '.join(map(str, wanted))})"
        rows = self._database.rows(
            f"SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ?{choice} ORDER BY timestamp, id",
            start_ns,
        )
        for number, time_ns, data in rows:
            if isinstance(time_ns, int) and isinstance(data, bytes):
                yield RawMessage(*self._topics[number], "", time_ns, data)

    def _report_log(self, path: Path) -> None:
        """Report messages that are not in the database yet: a recorder that did not end leaves them in a log."""
        log = path.with_name(f"{path.name}-wal")
        with suppress(OSError):  # there is none
            if log.stat().st_size > 0:
                self._report(
                    f"its recorder did not end: messages in {log} are not read; move them into the database first, by "
                    f"sqlite3 {shlex.quote(str(path))} 'PRAGMA wal_checkpoint'"
                )

    def _fill_contents(self) -> None:
        """Ask for counts, times, definitions and qualities of service."""
        counts = dict(self._database.rows("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        for number, (topic, kind) in self._topics.items():
            self.contents.add(topic, kind, counts.pop(number, 0))
        if counts:
            self._report(f"{sum(counts.values())} messages are of no topic that is known")
        for kind, text in self._database.definitions():
            self.contents.definitions[kind] = text
        for number, profiles in self._database.qos():
            topic = self._topics[number][0]
            try:
                self.contents.qos[topic] = qos_profiles(profiles)
            except ValueError as err:
                self._report(f"{topic}: {err}")
        ((start_ns, end_ns),) = self._database.rows("SELECT MIN(timestamp), MAX(timestamp) FROM messages")
        if isinstance(start_ns, int) and isinstance(end_ns, int):
            self.contents.start_ns, self.contents.end_ns = max(start_ns, 0), max(end_ns, 0)


class _Database:
    """A database that is open for reading: of tables alone, and in bounded time, for views may go on for ever."""

    def __init__(self, path: Path, *, is_damaged: bool = False) -> None:
        uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
        # A recording may be read by another thread than the one that opened it, but by one at a time.
        self._connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
        self._connection.text_factory = lambda data: data.decode(errors="replace")
        self._limit = 100 + path.stat().st_size * _STEPS_PER_BYTE // _STEPS
        self._n_steps = 0
        self._connection.set_progress_handler(self._is_endless, _STEPS)
        try:
            self._connection.execute("PRAGMA trusted_schema=OFF")
            if is_damaged:
                # SQLite refuses a file that is shorter than its header says, except in this mode, meant for repairs.
                self._connection.execute("PRAGMA writable_schema=ON")
            self._columns = {name: self._stored_columns(name) for name in _TABLES}
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._connection.close()

    def rows(self, query: str, *values: object) -> Iterator[Any]:
        self._n_steps = 0
        with closing(self._connection.execute(query, values)) as cursor:
            yield from cursor

    def topics(self) -> dict[int, tuple[str, str]]:
        """Return name and type of each topic by its number."""
        rows = self.rows(f"SELECT id, name, type {_TOPICS}")
        return {number: (str(name), str(kind)) for number, name, kind in rows}

    def definitions(self) -> Iterator[tuple[str, str]]:
        """Yield type and text of the messages' definitions, where there are any."""
        if {"topic_type", "encoded_message_definition"} <= self._columns["message_definitions"]:
            for kind, text in self.rows("SELECT topic_type, encoded_message_definition FROM message_definitions"):
                yield str(kind), str(text)

    def qos(self) -> Iterator[tuple[int, object]]:
        """Yield number and quality of service of the topics, where it is told."""
        if "offered_qos_profiles" in self._columns["topics"]:
            yield from self.rows(f"SELECT id, offered_qos_profiles {_TOPICS}")

    def _stored_columns(self, name: str) -> set[str]:
        """Return the columns of a table; raises ValueError where they are computed, by a view or otherwise."""
        kinds = list(self.rows("SELECT type, sql FROM sqlite_master WHERE name = ? AND type != 'index'", name))
        if not kinds and name == "message_definitions":
            return set()
        if len(kinds) != 1 or kinds[0][0] != "table" or "VIRTUAL" in str(kinds[0][1]).upper().split("(")[0].split():
            raise ValueError(f"it has no table {name!r}")
        columns = list(self.rows(f"PRAGMA table_xinfo({name})"))
        if any(hidden for *_, hidden in columns):
            raise ValueError(f"its table {name!r} has columns that are computed")
        return {str(column[1]) for column in columns}

    def _is_endless(self) -> bool:
        self._n_steps += 1
        return self._n_steps > self._limit


def scanned_sqlite(path: Path, report: Report) -> Iterator[RawMessage]:
    """Yield the messages of a damaged database in the order in which they were written; what is lost is reported.

    After the first damage, those of the pages that are there.
    """
    topics: dict[int, tuple[str, str]] = {}
    done: set[int] = set()
    try:
        with closing(_Database(path, is_damaged=True)) as database:
            topics = database.topics()
            for row in database.rows("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id"):
                number, topic, time_ns, data = row
                done.add(number)
                if topic in topics and isinstance(time_ns, int) and isinstance(data, bytes):
                    yield RawMessage(*topics[topic], "", time_ns, data)
                else:
                    report("a message is damaged")
    except (sqlite3.Error, ValueError) as err:
        report(f"cut off or damaged ({err})")
    else:
        return
    for found in message_rows(path) if topics else ():
        if found.number not in done and found.topic in topics:
            done.add(found.number)
            yield RawMessage(*topics[found.topic], "", found.time_ns, found.data)
