"""Finds methods of matching by name: ours, baselines, OpenCV's, and those that a user adds.

A method is a function ``(left, right, num_disparities) -> disparity``: images uint8 (H, W) or
(H, W, 3) in, disparities of the left one out, float32 or float64 (H, W) in pixels, 0 to
num_disparities - 1 or between these, NaN where there is no estimate. It may also return a pair of
these and of confidences, the same shape, the higher the more trusted.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from phasestereo._extras import require
from phasestereo._images import Map
from phasestereo.matchers import OtherMatcher, onnx, opencv
from phasestereo.matchers.opencv import Image
from phasestereo.matching import match
from phasestereo.opencv.storage import as_value
from phasestereo.preparation import prepare
from phasestereo.rig.findings import unwarned
from phasestereo.settings import PRESETS, Settings, resolve
from phasestereo_bench import mccnn, networks, program
from phasestereo_bench.arrays import Floats

Matcher: TypeAlias = Callable[..., "Floats | tuple[Floats, Floats]"]

TRUE_BLUR = "+true-blur"
"""Ending of a method's name: the method blurs the sharp image like the other one first."""

# Penalties are the best on 12 sharp Middlebury pairs, in gray levels and standard deviations; means
# of bad-1.0 in %:  SAD            5: 21.4   10: 20.3   15: 20.1   20: 20.2
#                  normalized SAD .3: 14.0   .5: 13.5  .75: 13.5    1: 13.8
BASELINES: Mapping[str, Settings] = {
    "sad": replace(PRESETS["paper"], cost="sad", p1=15, p2=15),
    "nsad": replace(PRESETS["paper"], cost="nsad", p1=0.5, p2=0.5),
}
"""Costs that phase codes are meant to replace, with the windows and the optimizer of
``"paper"``."""

_OPENCV: Mapping[str, tuple[Matcher, Mapping[str, Any]]] = {
    "opencv:bm": (opencv.match_bm, opencv.BM),
    **{
        f"opencv:sgbm{name}": (
            partial(opencv.match_sgbm, mode=mode, options=options),
            {**options, "mode": mode},
        )
        for name, mode, options in (
            ("", "HH", opencv.SGBM),
            ("-3x3", "HH", opencv.SGBM_3X3),
            ("-5way", "SGBM", opencv.SGBM),
            ("-3way", "SGBM_3WAY", opencv.SGBM),
        )
    },
}


@dataclass(frozen=True, slots=True)
class Method:
    """One way to match a pair.

    Parameters
    ----------
    name
        Name of the method in records and tables.
    match
        The function ``(left, right, num_disparities) -> disparity``; it may also return a pair of a
        disparity and a confidence.
    settings
        Other facts about the method, as JSON values.
    true_blur
        Whether the sharp image of the pair is first convolved with the blur of the other one, as a
        user who knew the blur could do.
    told
        Whether it gets the range, and also its start if that is not 0.
    """

    name: str
    match: Matcher
    settings: Mapping[str, Any] = field(default_factory=dict)
    true_blur: bool = False
    told: bool = True

    def __str__(self) -> str:
        """Return the name, with its ending."""
        return self.name + TRUE_BLUR * self.true_blur


def available() -> list[str]:
    """Return the names of all available methods, with OpenCV's if it is installed."""
    return [*PRESETS, *BASELINES, *(_OPENCV if find_spec("cv2") else ())]


def method(spec: str | Matcher | Method) -> Method:
    """Return the method of a specification.

    Parameters
    ----------
    spec
        The name of a preset or a baseline, with other settings if needed:
        ``"paper:neighborhood=11,window=9"``, ``"sad:p1=5,p2=8"``, and with
        ``"num_disparities=auto"`` given no range; ``"opencv:bm"``, ``"opencv:sgbm"``,
        ``"opencv:sgbm-3x3"`` or ``"opencv:sgbm-3way"``; a network by its file,
        ``"hitnet:FILE.onnx"``, ``"onnx:FILE.onnx"``, or ``"mccnn"``; any of these after
        ``"prepared:"``, as ``"prepared:sgbm"``: on the pair that `phasestereo.prepare` makes
        without a range; or after ``"fused:"``: as the second matcher of `phasestereo.match`, which
        gets no range either; a program,
        ``"program:COMMAND {left} {right} {num_disparities} {output}"``;
        ``"package.module:function"``; any of these followed by ``"+true-blur"``. Or such a
        function itself; or a `Method`, returned as it is.

    Raises
    ------
    TypeError, ValueError
        If the method or setting is unknown, if the setting does not take the value, or if a file is
        not HITNet's.
    OSError
        If there is no such file.
    ImportError
        If a package that it needs is not installed.
    """
    if isinstance(spec, Method):
        return spec

    if isinstance(spec, str):
        name = spec.removesuffix(TRUE_BLUR)
        return replace(_named(name), true_blur=name != spec)

    if not callable(spec):
        kind = type(spec).__name__
        raise TypeError(f"method: got {kind}; accepts a name, a function or a Method")

    if not hasattr(spec, "__qualname__"):
        kind = type(spec).__name__
        raise TypeError(f"method: got {kind}, which has no name; give it one: Method(name, ...)")
    return Method(f"{_module(spec)}:{spec.__qualname__}", spec)


def present(specs: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the methods that can run here, and a sentence on each other method.

    Raises
    ------
    OSError, ValueError
        As `method`.
    """
    there, missing = [], []
    for spec in specs:
        try:
            method(spec)
        except ImportError as error:
            missing.append(f"left out, {spec.partition(':')[0]}: {error}")
        else:
            there.append(spec)
    return there, missing


def _named(name: str) -> Method:
    stem, _, rest = name.partition(":")
    if stem in PRESETS or stem in BASELINES:
        return _ours(name, {**PRESETS, **BASELINES}[stem], rest)

    if name in _OPENCV:
        require("cv2", extra="opencv")
        return Method(name, *_OPENCV[name])

    if stem in _FROM_OUTSIDE:
        return _FROM_OUTSIDE[stem](name, rest)

    if rest and stem != "opencv":
        return _imported(name)

    raise ValueError(
        f"method: got {name!r}; accepts {', '.join(available())}, with other settings as in "
        f"paper:neighborhood=11,window=9, package.module:function, and {TRUE_BLUR} after any"
    )


def _ours(name: str, base: Settings, overrides: str) -> Method:
    try:
        options = _parsed(overrides)
        ranged = _has_range(options.pop("num_disparities", None))
        settings = resolve(None, base, options)
    except (TypeError, ValueError) as error:
        raise type(error)(f"method: got {name!r}: {error}") from error
    call = partial(_match, settings=settings, ranged=ranged)
    return Method(name, call, asdict(settings), told=ranged)


def _has_range(num_disparities: object) -> bool:
    """Return whether a method gets the number of disparities; only ``auto`` withholds it."""
    if num_disparities not in (None, "auto"):
        raise ValueError(f"num_disparities: got {num_disparities!r}; accepts auto alone")

    return num_disparities is None


def _match(
    left: Image, right: Image, num_disparities: int, *, settings: Settings, ranged: bool
) -> Map | tuple[Map, Map]:
    count = num_disparities if ranged else None
    with unwarned():  # the score shows how bad a map is
        result = match(left, right, num_disparities=count, settings=settings, threads=1)

    return result.disparity if result.confidence is None else (result.disparity, result.confidence)


def _network(name: str, path: str) -> Method:
    """Return a network from a file; its name is that of the file, without the folder."""
    stem = name.partition(":")[0]
    if not path:
        raise ValueError(f"method: got {name!r}; accepts {stem}:FILE.onnx")

    require("onnxruntime", extra="onnx")
    if stem == "hitnet":
        networks.require_hitnet(path)
    label = stem if stem == "hitnet" else f"{stem}:{Path(path).stem}"
    settings = {"sha256": networks.digest_of(path), "license": networks.license_of(path)}
    return Method(label, partial(onnx.match_onnx, path=path, threads=1), settings)


def _aided(name: str, rest: str) -> Method:
    """Return a method on prepared pairs; OpenCV's may have their names in `load_matcher`."""
    stem = name.partition(":")[0]
    if not rest:
        raise ValueError(f"method: got {name!r}; accepts {stem}:METHOD")
    inner = _named(f"opencv:{rest}" if rest in ("sgbm", "bm") else rest)
    run = _match_prepared if stem == "prepared" else _match_fused
    return Method(f"{stem}:{inner.name}", partial(run, inner=inner), inner.settings, told=False)


def _match_prepared(left: Image, right: Image, _num_disparities: int, *, inner: Method) -> Map:
    with unwarned():
        pair = prepare(left, right, threads=1)

    found = inner.match(pair.left, pair.right, pair.num_disparities)
    return pair.restore(found[0] if isinstance(found, tuple) else found)


def _match_fused(
    left: Image, right: Image, _num_disparities: int, *, inner: Method
) -> tuple[Map, Map]:
    def run(left: Image, right: Image, num_disparities: int) -> Floats:
        found = inner.match(left, right, num_disparities)
        return found[0] if isinstance(found, tuple) else found

    with unwarned():
        result = match(left, right, second=OtherMatcher(inner.name, run), threads=1)

    failed = [each.sentence for each in result.findings if each.topic == "map"]
    if failed or result.confidence is None:
        raise ValueError(f"{inner.name}: " + "; ".join(failed))
    return result.disparity, result.confidence


def _mccnn(name: str, rest: str) -> Method:
    if rest:
        raise ValueError(f"method: got {name!r}; mccnn takes no settings")
    mccnn.needed()
    return Method(name, mccnn.match_mccnn, mccnn.SETTINGS)


def _program(_name: str, command: str) -> Method:
    """Return a program; its name is that of its file, without the folder."""
    program.require_places(command)
    label = f"program:{Path(command.split(maxsplit=1)[0]).name}"
    return Method(label, partial(program.match_program, command=command), {"command": command})


_FROM_OUTSIDE: Mapping[str, Callable[[str, str], Method]] = {
    "hitnet": _network,
    "onnx": _network,
    "mccnn": _mccnn,
    "prepared": _aided,
    "fused": _aided,
    "program": _program,
}
"""Functions that make methods of things other than functions, from the name and the text after
it."""


def _parsed(overrides: str) -> dict[str, Any]:
    """Read ``a=1,b=2,3`` as ``{"a": 1, "b": (2, 3)}``."""
    words: dict[str, list[Any]] = {}
    for part in overrides.split(",") if overrides else ():
        name, equals, value = part.rpartition("=")
        if equals:
            words[name.strip()] = []
        elif not words:
            raise ValueError(f"got {part!r}; accepts settings such as window=9")
        # A part without an equals sign continues the values of the previous setting.
        words[list(words)[-1]].append(as_value(value.strip()))

    return {name: tuple(values) if values[1:] else values[0] for name, values in words.items()}


def _imported(name: str) -> Method:
    module, _, function = name.partition(":")
    try:
        found: Any = import_module(module)
        for part in function.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"method: got {name!r}, which cannot be imported: {error}") from error

    if not callable(found):
        raise TypeError(f"method: {name!r} is not a function but {type(found).__name__}")
    return Method(name, found)


def _module(function: Matcher) -> str:
    """Return the name of a function's module; for a script that runs, the name it would have."""
    script = getattr(sys.modules["__main__"], "__file__", None)
    if function.__module__ == "__main__" and script is not None:
        return Path(script).stem
    return function.__module__
