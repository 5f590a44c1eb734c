"""``phasestereo batch``: makes a disparity map for each pair of a list or a folder."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

import phasestereo
from phasestereo.cli.errors import CommandError, refusals, wrong
from phasestereo.cli.options import (
    AT_LEAST_ONE,
    NOT_NEGATIVE,
    POSITIVE,
    PRESET_HELP,
    REASONABLE,
    SETTINGS_HELP,
    Count,
    Overrides,
)
from phasestereo.cli.terminal import print_json, print_lines, progress_bar, say
from phasestereo.result import Layer
from phasestereo.settings import PRESET, Settings, resolve
from phasestereo_large.batch import BatchReport, Record, encryption, read_pairs, run

_VALUES = {"preset", "num_disparities", "min_disparity", "threads", "workers", "scheduler"}
_MORE = {"retries", "layers", "time_limit"}
_OPTIONS = _VALUES | _MORE | {field.name for field in fields(Settings)}

_OUTPUT = Group.create_ordered("Output")
_SEARCH = Group.create_ordered("Search")
_WORK = Group.create_ordered("Work")
_SETTINGS = Group.create_ordered("Expert settings", help=SETTINGS_HELP)
_LISTED = 1000  # failures in the JSON: the manifest has all of them

_Count = Annotated[int | None, Parameter(group=_WORK, validator=AT_LEAST_ONE)]
_File = Annotated[Path | None, Parameter(group=_WORK)]
_Layers = tuple[Layer, ...]


def batch(
    source: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o", group=_OUTPUT)],
    format: Annotated[Literal["tif", "pfm", "npy"], Parameter(group=_OUTPUT)] = "tif",  # noqa: A002 -- the name of the option
    layers: Annotated[
        _Layers, Parameter(group=_OUTPUT, consume_multiple=True, show_default=False)
    ] = (),
    json: Annotated[bool, Parameter(negative=(), show_default=False, group=_OUTPUT)] = False,
    num_disparities: Annotated[Count, Parameter(group=_SEARCH, validator=AT_LEAST_ONE)] = None,
    min_disparity: Annotated[int, Parameter(group=_SEARCH, validator=REASONABLE)] = 0,
    preset: Annotated[str, Parameter(group=_SEARCH, help=PRESET_HELP)] = PRESET,
    scheduler: Annotated[str | None, Parameter(group=_WORK)] = None,
    tls_ca: _File = None,
    tls_cert: _File = None,
    tls_key: _File = None,
    workers: _Count = None,
    threads: _Count = None,
    retries: Annotated[int, Parameter(group=_WORK, validator=NOT_NEGATIVE)] = 2,
    time_limit: Annotated[float | None, Parameter(group=_WORK, validator=POSITIVE)] = None,
    overrides: Annotated[Overrides | None, Parameter(name="*", group=_SETTINGS)] = None,
) -> None:
    """Match many pairs, on all processors of this machine or on a Dask cluster.

    The command skips pairs that already have a result in the output folder, so the same command
    continues after any end. The file ``manifest.jsonl`` there records the outcome of every pair,
    one JSON object per line. Pairs that fail get another try at the end, and a record with the
    reason; the exit code is then 1. For example:

    ```
    phasestereo batch pairs.csv --num-disparities 128 -o maps
    phasestereo batch folder -o maps
    phasestereo batch pairs.csv --scheduler tcp://host:8786 -o /shared/maps
    ```

    Parameters
    ----------
    source
        A folder with subfolders left and right, a folder of scenes with im0.png, im1.png and
        calib.txt (Middlebury), or a CSV file with columns left and right. Such a file may also have
        the columns name, num_disparities, min_disparity, left_mask, right_mask; its paths are
        relative to it.
    output
        Folder for the results, NAME.tif and so on; on a cluster, a folder that all machines share.
    format
        Format of the disparities; .tif keeps the georeference of the left image.
    layers
        flags, confidence, uncertainty (the error bars): layers to write beside the disparities, as
        NAME.flags.tif and so on.
    json
        Print one JSON object on standard output: numbers, settings, failures, files.
    num_disparities
        Number of disparities to search, if the list or calib.txt does not give it; auto: find it in
        the images of each pair.
    min_disparity
        Smallest disparity to search, if the list does not give it.
    scheduler
        Address of a Dask cluster's scheduler, tls://HOST:PORT, or tcp://HOST:PORT in a network
        where you trust every user: anyone who can connect can run any code.
    tls_ca
        File of the certificates that must sign the cluster's own certificate.
    tls_cert
        File of your certificate for the connection.
    tls_key
        File of your certificate's key.
    workers
        Number of processes on this machine; without it, one per processor.
    threads
        Number of threads per match; without it, enough to keep all processors of this machine busy,
        and 1 on a cluster.
    retries
        Number of retries for a pair that failed.
    time_limit
        Seconds that a pair may take; without it, no limit.
    """
    if (tls_ca or tls_cert or tls_key) and scheduler is None:
        raise wrong("tls_ca", "has no effect without --scheduler")

    with refusals(options=_OPTIONS):
        settings = resolve(preset, None, overrides or {})
        pairs = read_pairs(source, num_disparities=num_disparities, min_disparity=min_disparity)

    with refusals(options=_OPTIONS), progress_bar("Matching") as progress:
        report = run(
            pairs,
            output,
            scheduler=scheduler,
            security=_security(tls_ca, tls_cert, tls_key),
            workers=workers,
            threads=threads,
            retries=retries,
            time_limit=time_limit,
            suffix=f".{format}",
            layers=layers,
            settings=settings,
            progress=progress,
            on_failure=_show_failure,
        )

    for line in report.damaged:
        say(f"{line}; set apart, and its pair matched again")
    _show(report, settings, as_json=json)
    if report.failed:
        raise CommandError(
            f"{len(report.failed)} of {report.pairs} pairs failed; {report.manifest} says why, "
            "and the same command tries them again"
        )


def _show_failure(record: Record) -> None:
    say(f"failed {record.name}: {record.reason}")


def _security(ca: Path | None, cert: Path | None, key: Path | None) -> Any:
    """Return the encryption of a connection, or None without encryption."""
    if not (ca or cert or key):
        return None
    if ca is None or cert is None or key is None:
        raise wrong("tls_ca", "needs --tls-cert and --tls-key, and they it")
    return encryption(ca, cert, key)


def _show(report: BatchReport, settings: Settings, *, as_json: bool) -> None:
    """Print the outcome of a run on standard output."""
    if as_json:
        print_json(
            {
                "version": phasestereo.__version__,
                "settings": asdict(settings),
                "pairs": report.pairs,
                "done": report.done,
                "skipped": report.skipped,
                "failed": len(report.failed),
                "failures": [asdict(record) for record in report.failed[:_LISTED]],
                "seconds": report.seconds,
                "manifest": str(report.manifest),
                "damaged": list(report.damaged),
            }
        )
        return

    rate = report.done / report.seconds if report.seconds else 0.0
    pairs = "1 pair" if report.done == 1 else f"{report.done} pairs"
    numbers = (
        f"{pairs} matched, {report.skipped} there already, {len(report.failed)} failed, "
        f"{report.seconds:.1f} s, {rate:.2f} pairs/s"
    )
    print_lines([numbers, f"wrote {report.manifest}"])
