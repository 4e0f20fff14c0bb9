"""Names of the topics that nodes subscribe to, and recordings are searched for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

LEFT_IMAGE = "left/image_rect"
RIGHT_IMAGE = "right/image_rect"
LEFT_RAW = "left/image_raw"
RIGHT_RAW = "right/image_raw"
LEFT_INFO = "left/camera_info"
RIGHT_INFO = "right/camera_info"
DISPARITY = "disparity"
DEPTH_IMAGE = "depth/image_rect"
DEPTH_INFO = "depth/camera_info"
OCCUPANCY = "short_range/occupancy"
GROUND_DISPARITY = "short_range/ground_disparity"

PARTNER = {"stereo": RIGHT_IMAGE, "disparity": DISPARITY, "depth": DEPTH_IMAGE}
"""Partner of the left image for each source of disparity, in the order of preference."""

IMAGE_TYPE = "sensor_msgs/msg/Image"
COMPRESSED_TYPE = "sensor_msgs/msg/CompressedImage"
INFO_TYPE = "sensor_msgs/msg/CameraInfo"
DISPARITY_TYPE = "stereo_msgs/msg/DisparityImage"

_TYPES = {
    LEFT_IMAGE: (IMAGE_TYPE, COMPRESSED_TYPE),
    RIGHT_IMAGE: (IMAGE_TYPE, COMPRESSED_TYPE),
    LEFT_RAW: (IMAGE_TYPE, COMPRESSED_TYPE),
    RIGHT_RAW: (IMAGE_TYPE, COMPRESSED_TYPE),
    DISPARITY: (DISPARITY_TYPE,),
    DEPTH_IMAGE: (IMAGE_TYPE, COMPRESSED_TYPE),
    LEFT_INFO: (INFO_TYPE,),
    RIGHT_INFO: (INFO_TYPE,),
    DEPTH_INFO: (INFO_TYPE,),
}
_IMAGES_OF = {LEFT_INFO: (LEFT_RAW, LEFT_IMAGE), RIGHT_INFO: (RIGHT_RAW, RIGHT_IMAGE), DEPTH_INFO: (DEPTH_IMAGE,)}
_ENDS = {
    "image_rect": ("image_rect", "image_rect_color", "image_raw"),
    "image_raw": ("image_raw", "image_color", "image_mono"),
}
_TRANSPORTS = ("", "/compressed", "/compressedDepth")


def image_inputs(source: str, *, rectify: bool = False) -> tuple[str, str]:
    """Return the canonical names of the left image and of its partner, raw where a stereo pair is to be rectified."""
    return (LEFT_RAW, RIGHT_RAW) if rectify and source == "stereo" else (LEFT_IMAGE, PARTNER[source])


def required_inputs(source: str, *, rectify: bool = False, register: bool = False) -> tuple[str, ...]:
    """Return the canonical names of the topics that a source requires; depth's own calibration where to `register`."""
    infos = (LEFT_INFO, RIGHT_INFO) if source == "stereo" else (LEFT_INFO,)
    infos = (LEFT_INFO, DEPTH_INFO) if source == "depth" and register else infos
    return (*image_inputs(source, rectify=rectify), *infos)


def find_inputs(
    topics: Mapping[str, str],
    source: str,
    remaps: Mapping[str, str],
    *,
    rectify: bool = False,
    register: bool = False,
) -> tuple[str, dict[str, str]]:
    """Find the inputs among the topics of a recording, under any one namespace.

    Parameters
    ----------
    topics : mapping of str to str
        Type of each topic.
    source : str
        The preferred one of ``stereo``, ``disparity`` and ``depth``.
    remaps : mapping of str to str
        Topics that the user names, by canonical name; the others are searched for.
    rectify : bool
        Whether a stereo pair is raw images.
    register : bool
        Whether the depth image has a camera of its own.

    Returns
    -------
    source : str
        The preferred one where it is complete, else the first that is.
    inputs : dict of str to str
        The topic of each canonical name that is used.

    Raises
    ------
    ValueError
        If a remap names no input or no topic of its type, or if no source is complete; the message lists the topics.
    """
    # ROS 1 records relative names too.
    absolute = {f"/{topic.strip('/')}": topic for topic in topics}
    types = {name: topics[topic] for name, topic in absolute.items()}
    named = {role: _remapped(types, role, topic) for role, topic in remaps.items()}
    for kind in dict.fromkeys((source, *PARTNER)):
        for namespace in _namespaces(types):
            inputs = _inputs(types, namespace, named)
            required = required_inputs(kind, rectify=rectify, register=register)
            if all(role in inputs for role in required):
                used = dict.fromkeys((*required, RIGHT_INFO))
                return kind, {role: absolute[inputs[role]] for role in used if role in inputs}
    needed = "; or ".join(", ".join(required_inputs(kind, rectify=rectify, register=register)) for kind in PARTNER)
    remedy = "; set source.rectify to false where images are rectified" if rectify else ""
    raise ValueError(
        f"lacks topics for frames; needed in one namespace are {needed}; there are {_listed(types)}{remedy}"
    )


def _inputs(types: Mapping[str, str], namespace: str, named: Mapping[str, str]) -> dict[str, str]:
    """Return the topic of each canonical name that is there under a namespace, or that the user names."""
    found = dict(named)
    for role in _TYPES:
        if role in found:
            continue
        candidates = [f"{namespace}/{end}" for end in _ends(role)]
        images = [found[image] for image in _IMAGES_OF.get(role, ()) if image in found]
        # Calibration stands beside its image.
        candidates += [f"{_without_transport(image).rpartition('/')[0]}/camera_info" for image in images]
        for topic in candidates:
            if types.get(topic) in _TYPES[role]:
                found[role] = topic
                break
    return found


def _without_transport(topic: str) -> str:
    """Return the name of the image that is compressed on a topic."""
    return topic.removesuffix("/compressed").removesuffix("/compressedDepth")


def namespace_of(topic: str) -> str:
    """Return what stands before the name of a left image: empty, or such as ``/front``."""
    absolute = f"/{topic.strip('/')}"
    ends = (*_ends(LEFT_IMAGE), *_ends(LEFT_RAW))
    end = next((end for end in ends if absolute.endswith(f"/{end}")), "")
    return absolute.removesuffix(f"/{end}") if end else ""


def _ends(role: str) -> list[str]:
    """Return the names to look for in place of a canonical one, the best first."""
    namespace, _, image = role.rpartition("/")
    if image not in _ENDS:
        return [role]
    names = [f"{namespace}/{end}" for end in _ENDS[image]]
    return [f"{name}{transport}" for name in names for transport in _TRANSPORTS]


def _namespaces(topics: Iterable[str]) -> list[str]:
    """Return the namespaces under which there are any inputs, those with the fewest parts first."""
    ends = [f"/{end}" for role in _TYPES for end in _ends(role)]
    found = {topic.removesuffix(end) for topic in topics for end in ends if topic.endswith(end)}
    return sorted(found | {""}, key=lambda namespace: (namespace.count("/"), namespace))


def _remapped(types: Mapping[str, str], role: str, name: str) -> str:
    """Return the topic that the user names, plain or compressed."""
    if role not in _TYPES:
        raise ValueError(f"{role!r} is no input that could be remapped; give one of {', '.join(_TYPES)}")
    for transport in _TRANSPORTS:
        topic = f"/{name.strip('/')}{transport}"
        if types.get(topic) in _TYPES[role]:
            return topic
    kinds = " or ".join(_TYPES[role])
    raise ValueError(f"has no topic {name!r} of type {kinds} for {role}; there are {_listed(types)}")


def _listed(types: Mapping[str, str]) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(types.items())) or "no topics at all"
