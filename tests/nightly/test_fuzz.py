"""Mutated files of every format, and all that fuzzing ever found: documented errors alone."""

import shutil
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from itertools import islice
from pathlib import Path

import pytest

from support import NIGHTLY, counterpart, sampled

for _module in ("PIL", "tifffile", "rasterio", "zarr", "cv2", "yaml", "scipy"):
    counterpart(_module)
fuzzing = import_module("support.fuzzing")


FILES = 2000 if NIGHTLY else 200


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    made: list[Path] = fuzzing.make_corpus(tmp_path_factory.mktemp("fuzz") / "corpus")
    return made


def test_the_files_that_are_mutated_are_sound(corpus: list[Path]) -> None:
    """Each is read by one of its readers at least: others may want a map, or a matrix."""
    for path in corpus:
        copy = Path(shutil.copy(path, corpus[0].parent.parent / path.name))
        readers = [read for read, suffixes in fuzzing.READERS.values() if path.suffix in suffixes]
        assert any(is_read(read, copy) for read in readers), path


def is_read(read: Callable[[Path], object], path: Path) -> bool:
    try:
        read(path)
    except ValueError:
        return False
    return True


def test_a_byte_that_is_wrong_is_passed_over_or_named_with_the_file(corpus: list[Path]) -> None:
    """Content that is damaged is a ValueError, and names the file; the system has no part in it."""
    folder, read, wrong = corpus[0].parent.parent, Counter[str](), []

    for name, (_, suffixes) in fuzzing.READERS.items():
        for source in corpus:
            if source.suffix not in suffixes or name == "match":
                continue
            path = folder / f"{name}{source.suffix}"
            for content in sampled([*fuzzing.flipped(source.read_bytes())]):
                path.write_bytes(content)
                read[name] += 1
                if message := fuzzing.complaint(name, path):
                    wrong.append((source.name, str(fuzzing.keep(path, folder / "wrong")), message))

    assert wrong == []
    assert min(read.values()) > (30 if NIGHTLY else 3)
    assert read.keys() == fuzzing.READERS.keys() - {"match"}


def test_mutated_files_are_read_or_refused(corpus: list[Path]) -> None:
    folder, wrong = corpus[0].parent.parent, []
    for name, suffix, content in islice(fuzzing.cases(corpus, seed=0), FILES):
        path = folder / f"{name}{suffix}"
        path.write_bytes(content)
        if message := fuzzing.complaint(name, path):
            wrong.append((str(fuzzing.keep(path, folder / "wrong")), message))
    assert wrong == []


def test_what_fuzzing_found_is_read_or_refused(corpus: list[Path]) -> None:
    """Files in tests/found, which `make fuzz` fills; their names begin with their reader's."""
    for path in sorted(fuzzing.FOUND.iterdir()) if fuzzing.FOUND.exists() else []:
        copy = shutil.copy(path, corpus[0].parent.parent / path.name)
        assert fuzzing.complaint(path.stem.rpartition("-")[0], copy) is None, path
