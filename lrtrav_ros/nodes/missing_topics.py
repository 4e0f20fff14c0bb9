"""Why nothing comes on a topic: who publishes it, with which type and QoS, and which topics could be meant."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Any

from rclpy.node import Node
from rclpy.qos import (
    QoSCompatibility,
    QoSDurabilityPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.subscription import Subscription

from lrtrav_ros.io.topics import COMPRESSED_TYPE, IMAGE_TYPE, INFO_TYPE, LEFT_IMAGE

_N_LISTED = 3
_OWN = {"short_range", "long_range", "segmentation"}  # what this package publishes is no camera's
_SIDES = {"left": "left", "infra1": "left", "cam0": "left", "right": "right", "infra2": "right", "cam1": "right"}
_PAIR = {f"{side}/image_{kind}" for side in ("left", "right") for kind in ("rect", "raw")}
_RECTIFIED = {"rect", "rectified"}
_REGISTERED = {"aligned", "registered"}
_GREY = {"gray", "grey", "mono"}
_NO_CAMERA = {"depth", "disparity", "confidence", "mask"}


class AwaitedTopics:
    """The topics that a node waits for, and what is to be done about those on which nothing has come.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes to them.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._start_s = time.monotonic()
        self._awaited: list[tuple[str, Subscription, Callable[[], bool]]] = []

    def add(self, name: str, subscription: Subscription, has_come: Callable[[], bool]) -> None:
        """Wait for a topic.

        Parameters
        ----------
        name : str
            Relative name to remap, without a transport, such as ``left/image_rect``.
        subscription : rclpy.subscription.Subscription
            What is subscribed to.
        has_come : callable
            Returns whether any message has come.
        """
        self._awaited.append((name, subscription, has_come))

    def forget(self) -> None:
        """Wait anew from now on."""
        self._start_s = time.monotonic()

    def problem(self, patience_s: float) -> str:
        """Return a line for each topic on which nothing has come in this time [s]; the graph is asked only then."""
        waited_s = time.monotonic() - self._start_s
        if waited_s < patience_s:
            return ""
        missing = [(name, subscription) for name, subscription, has_come in self._awaited if not has_come()]
        missing.sort(key=lambda item: _type_name(item[1].msg_type) == INFO_TYPE)  # images before their calibration
        return "\n".join(explain_silence(self._node, name, each, waited_s=waited_s) for name, each in missing)


def explain_silence(node: Node, name: str, subscription: Subscription, *, waited_s: float) -> str:
    """Return one line on why nothing has come on a topic, and what to do about it.

    Parameters
    ----------
    node : rclpy.node.Node
        Asks the graph.
    name, subscription
        As for `AwaitedTopics.add`.
    waited_s : float
        Seconds since the start.

    Returns
    -------
    str
        The topic, its type and QoS; who publishes it with which other type or QoS; topics that could be meant, and the
        arguments to start with.
    """
    try:
        wanted, qos = _Wanted.of(node, name, subscription), subscription.qos_profile
        text = f"nothing has come on {wanted.topic} ({wanted.type}, {_qos_text(qos)}) for {waited_s:.0f} s"
        return f"{text}: {_reason(node, wanted, qos)}"
    except Exception as err:  # a node lives on without an explanation; one that is ending cannot ask the graph any more
        return f"nothing has come on {name} for {waited_s:.0f} s ({err})"


def explain_publishers(node: Node, topic: str) -> str:
    """Return who publishes a topic where more than one does, so that their messages mix; empty elsewhere."""
    n = node.count_publishers(topic)
    if n < 2:
        return ""
    names = _names(node.get_publishers_info_by_topic(topic))
    return f"{n} publishers on {topic}: {names}; end all but one, or remap"


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What is subscribed to: the name to remap, the full name and the type, and what the parameters say of images."""

    name: str
    topic: str
    type: str
    is_stereo: bool
    is_registered: bool
    rectifies: bool

    @classmethod
    def of(cls, node: Node, name: str, subscription: Subscription) -> _Wanted:
        return cls(
            name,
            subscription.topic_name,
            _type_name(subscription.msg_type),
            is_stereo=_value(node, "source", "stereo") == "stereo",
            is_registered=bool(_value(node, "source.depth_registered", True)),
            rectifies=bool(_value(node, "source.rectify", False)),
        )

    @property
    def is_image(self) -> bool:
        """Whether it is an image, compressed or not."""
        return self.type in (IMAGE_TYPE, COMPRESSED_TYPE)

    @property
    def types(self) -> tuple[str, ...]:
        """The types that a parameter may choose."""
        return (IMAGE_TYPE, COMPRESSED_TYPE) if self.is_image else (self.type,)

    @property
    def is_own(self) -> bool:
        """Whether it is this package that publishes it."""
        return self.name.split("/")[0] in _OWN or (self.rectifies and self.name == LEFT_IMAGE)

    @property
    def is_raw(self) -> bool:
        """Whether images as the lens makes them are wanted."""
        return self.name.endswith("image_raw")

    @property
    def is_of_depth(self) -> bool:
        """Whether it is a depth image or its calibration."""
        return self.name.startswith("depth/")

    @property
    def transport(self) -> str:
        """What image_transport adds to the name for compressed images."""
        return "compressedDepth" if self.is_of_depth else "compressed"


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A topic that could be meant."""

    topic: str
    type: str
    wanted: _Wanted

    @property
    def base(self) -> str:
        """Its name without the transport."""
        return self.topic.removesuffix(f"/{self.wanted.transport}") if self.type == COMPRESSED_TYPE else self.topic

    @property
    def words(self) -> set[str]:
        """The words that its name is made of."""
        return set(_words(self.base))

    @property
    def changes_rectification(self) -> bool:
        """Whether it is raw where rectified images of a pair are wanted, or the reverse."""
        is_of_pair = self.wanted.is_stereo and self.wanted.name in _PAIR
        return is_of_pair and bool(self.words & _RECTIFIED) == self.wanted.is_raw

    @property
    def is_reachable(self) -> bool:
        """Whether parameters that the node does not have yet make it an input."""
        if self.type == COMPRESSED_TYPE and self.base == self.topic:
            return False  # of another transport
        return not self.changes_rectification or self.wanted.rectifies == self.wanted.is_raw

    @property
    def fits(self) -> bool:
        """Whether it could be meant, by its name."""
        wanted, words = self.wanted, self.words
        if wanted.is_own:
            return self.base.rpartition("/")[2] == wanted.name.rpartition("/")[2]
        if not wanted.is_image and wanted.type != INFO_TYPE:
            return True
        if wanted.is_of_depth:
            return "depth" in words or ("stereo" in words and _side(self.base) is None)
        return (wanted.type == INFO_TYPE or "image" in words) and not words & _NO_CAMERA and self._has_side is not False

    @property
    def rank(self) -> tuple[bool, bool, bool, bool, float, int, str]:
        """Key by which the likeliest is the least."""
        name, is_other_type = self.wanted.name, self.type != self.wanted.type
        ending = "/".join(self.base.split("/")[-(name.count("/") + 1) :])
        likeness = SequenceMatcher(None, name, ending).ratio()
        is_second = self.changes_rectification or self._is_second_choice
        return not self._has_side, is_second, is_other_type, self._is_grey, -likeness, len(self.topic), self.topic

    @property
    def _has_side(self) -> bool | None:
        """Whether it is of the side that is wanted; None where its name has none."""
        side, own = _side(self.wanted.name), _side(self.base)
        return None if side is None or own is None else side == own

    @property
    def _is_second_choice(self) -> bool:
        """Whether another view of the same depth, or another calibration of the same camera, fits better."""
        if self.wanted.is_of_depth:
            return bool(self.words & _REGISTERED) != self.wanted.is_registered
        return self.wanted.type == INFO_TYPE and ("raw" in self.words) != self.wanted.rectifies

    @property
    def _is_grey(self) -> bool:
        return bool(self.words & _GREY)

    def arguments(self, node: Node) -> str:
        """Return the ROS arguments that make the node subscribe to it."""
        wanted, name = self.wanted, self.wanted.name
        texts = []
        if self.type != wanted.type:
            texts.append(f"-p source.compressed:={_spelt(self.type == COMPRESSED_TYPE)}")
        if self.changes_rectification:
            texts.append(f"-p source.rectify:={_spelt(not wanted.is_raw)}")
            name = name.replace("raw", "rect") if wanted.is_raw else name.replace("rect", "raw")
        if node.resolve_topic_name(name) != self.base:
            texts.append(f"-r {name}:={self.base}")
        return " ".join(texts)


def _reason(node: Node, wanted: _Wanted, qos: QoSProfile) -> str:
    """Return who publishes a topic and why that does not come, or what to subscribe to in its place."""
    publishers = node.get_publishers_info_by_topic(wanted.topic)
    same = [publisher for publisher in publishers if publisher.topic_type == wanted.type]
    if not publishers:
        return f"nobody publishes it{_advice(node, wanted)}"
    if not same:
        kinds = " and ".join(sorted({publisher.topic_type for publisher in publishers}))
        return f"it is published by {_names(publishers)} as {kinds}, not {wanted.type}{_advice(node, wanted)}"
    refusals = [_refusal(wanted.topic, publisher.qos_profile, qos) for publisher in same]
    if all(refusals):
        return f"it is published by {_names(same)} {refusals[0]}"
    return f"it is published by {_names(same)}, but no message has come: none is sent, or all are lost on the way"


def _advice(node: Node, wanted: _Wanted) -> str:
    """Return which topics there are in place of a missing one, and the arguments to write for the likeliest."""
    candidates = sorted(_candidates(node, wanted), key=lambda each: (not each.fits, each.rank))
    if candidates and candidates[0].fits:
        best = candidates[0]
        topics = [each.topic for each in candidates if each.type == best.type]
        kind = "of this type" if best.type == wanted.type else f"({best.type})"
        return f"; there {_listed(topics)} {kind}: start with {best.arguments(node)}"
    if wanted.is_own:
        return ": start the short-range node, or remap it"
    topics = [each.topic for each in candidates if each.type == wanted.type]
    return f"; there {_listed(topics)} of this type" if topics else ", nor any other topic of this type"


def _candidates(node: Node, wanted: _Wanted) -> Iterator[_Candidate]:
    """Yield the published topics that parameters and a remap would make an input."""
    passed_over = {wanted.topic, *(publisher.topic_name for publisher in node.publishers)}
    for topic, types in node.get_topic_names_and_types():
        if topic in passed_over or (_OWN & set(topic.split("/")) and not wanted.is_own):
            continue
        for kind in set(types) & set(wanted.types):
            candidate = _Candidate(topic, kind, wanted)
            # A topic that is only subscribed to is in the graph as well.
            if candidate.is_reachable and node.count_publishers(topic):
                yield candidate


def _value(node: Node, parameter: str, default: Any) -> Any:
    """Return the value of a parameter; the default where the node has none of this name."""
    return node.get_parameter(parameter).value if node.has_parameter(parameter) else default


def _refusal(topic: str, published: QoSProfile, wanted: QoSProfile) -> str:
    """Return why a subscription does not get what is published, and the remedy; empty where it does."""
    compatibility, reason = qos_check_compatible(published, wanted)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    for policy, weak in (
        ("reliability", QoSReliabilityPolicy.BEST_EFFORT),
        ("durability", QoSDurabilityPolicy.VOLATILE),
    ):
        given, asked = getattr(published, policy), getattr(wanted, policy)
        if given == weak != asked:
            return (
                f"with {policy} {_spelt(given)}, which a {_spelt(asked)} subscription does not get: "
                f"set qos_overrides.{topic}.subscription.{policy} to {_spelt(given)}"
            )
    return f"with a QoS that does not fit: {reason}"


def _names(publishers: Iterable[Any]) -> str:
    """Return the full names of the nodes that publish."""
    return " and ".join(sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in publishers}))


def _listed(names: list[str]) -> str:
    """Return a verb and the first of some topics."""
    more = f" and {len(names) - _N_LISTED} more" if len(names) > _N_LISTED else ""
    return f"{'is' if len(names) == 1 else 'are'} {', '.join(names[:_N_LISTED])}{more}"


def _side(topic: str) -> str | None:
    """Return the side that a name gives last; None where it gives none."""
    sides = [_SIDES[word] for word in _words(topic) if word in _SIDES]
    return sides[-1] if sides else None


def _words(topic: str) -> list[str]:
    return [word for word in re.split(r"[/_]", topic.lower()) if word]


def _type_name(kind: type[Any]) -> str:
    """Return the name that ROS has for a class of messages."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def _qos_text(qos: QoSProfile) -> str:
    """Return what of a subscription's QoS decides whom it gets messages from."""
    is_kept = qos.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    text = _spelt(qos.reliability).replace("_", " ")
    return f"{text}, transient local" if is_kept else text


def _spelt(value: Any) -> str:
    """Return a truth value or a policy as parameters spell it."""
    return str(value).lower() if isinstance(value, bool) else value.name.lower()
