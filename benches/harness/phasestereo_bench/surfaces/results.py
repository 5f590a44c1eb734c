"""Turns the records of the trials into tables."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean
from typing import Any

from phasestereo_bench.report.tables import MISSING, Table
from phasestereo_bench.surfaces.cases import AS_IS, OWN
from phasestereo_bench.surfaces.measures import KINDS

Record = Mapping[str, Any]
Found = Mapping[str, Any]

FEWEST = 100
"""A scene needs this many pixels of a kind to be part of the kind's mean."""

_HEADINGS = {"edge": "near an edge"}


def surface_table(records: Sequence[Record]) -> Table:
    """Return rows and methods down, kinds of pixels across: bad-1 / bad-2 in %, means of scenes."""
    header = "row", "method", "scenes", *(_HEADINGS.get(kind, kind) for kind in KINDS), "stripes"
    rows = []
    for (row, method), views in _by_row(records).items():
        cells = (_bad(views, kind) for kind in KINDS)
        rows.append((row, method, str(len(views)), *cells, _stripes(views)))
    return Table.of(header, rows, labels=2)


def upsampled_table(records: Sequence[Record]) -> Table | None:
    """Return bad-1 of upsampled scenes at their own scale, beside that of the original scenes.

    Means over the scenes, and the scene that loses most; None if no scene is upsampled.
    """
    found = {
        (row, record["method"], record["scene"]): _share(view, "bad_1", "all")
        for record in records
        for row, view in record["views"].items()
        if row == AS_IS or (row.startswith("upsampled") and not row.endswith(OWN))
    }

    rows = []
    for row, method in dict.fromkeys((row, method) for row, method, _ in found if row != AS_IS):
        changes = {
            scene: (share, found[AS_IS, method, scene])
            for (of_row, of_method, scene), share in found.items()
            if (of_row, of_method) == (row, method) and (AS_IS, method, scene) in found
        }
        if changes:
            worst = max(changes, key=lambda scene: changes[scene][0] - changes[scene][1])
            now, then = (100 * fmean(column) for column in zip(*changes.values(), strict=True))
            most = 100 * (changes[worst][0] - changes[worst][1])
            rows.append((row, method, f"{then:.1f}", f"{now:.1f}", f"{most:+.1f}", worst))

    header = "row", "method", "as they are", "upsampled", "worst change", "of"
    return Table.of(header, rows, labels=2) if rows else None


def shares_by_kind(records: Iterable[Record]) -> dict[str, dict[str, dict[str, float]]]:
    """Return bad-1 in % by row, method and kind: means over the scenes with enough pixels."""
    shares: dict[str, dict[str, dict[str, float]]] = {}
    for (row, method), views in _by_row(records).items():
        means = {kind: _mean(views, "bad_1", kind) for kind in KINDS}
        known = {kind: mean for kind, mean in means.items() if mean is not None}
        shares.setdefault(row, {})[method] = known
    return shares


def _by_row(records: Iterable[Record]) -> dict[tuple[str, str], list[Found]]:
    """Return the counts by row and method, rows in order."""
    grouped: dict[str, dict[str, list[Found]]] = {}
    for record in records:
        for row, view in record["views"].items():
            grouped.setdefault(row, {}).setdefault(record["method"], []).append(view)
    return {(row, method): views for row, some in grouped.items() for method, views in some.items()}


def _share(view: Found, measure: str, kind: str) -> float:
    return float(view[measure][kind] / view["pixels"][kind])


def _bad(views: Sequence[Found], kind: str) -> str:
    """Return means over the scenes with enough pixels of a kind."""
    one, two = (_mean(views, name, kind) for name in ("bad_1", "bad_2"))
    return MISSING if one is None else f"{one:.1f} / {two:.1f}"


def _mean(views: Sequence[Found], measure: str, kind: str) -> float | None:
    """Return a mean in % over the scenes with enough pixels of a kind; None without any."""
    some = [view for view in views if view["pixels"][kind] >= FEWEST]
    return 100 * fmean(_share(each, measure, kind) for each in some) if some else None


def _stripes(views: Sequence[Found]) -> str:
    """Return the share of stripes, and that of the truth in brackets."""
    known = [view for view in views if view["stripes"] is not None]
    if not known:
        return MISSING
    found, true = (fmean(view[name] for view in known) for name in ("stripes", "truth_stripes"))
    return f"{100 * found:.2f} ({100 * true:.2f})"
