"""Defines the kinds of parameters that several commands share."""

from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter, validators

SEVERAL = Parameter(consume_multiple=True, show_default=False)
SCENES = Group.create_ordered("Scenes")
CELLS = Group.create_ordered("Degradations and methods")
RUN = Group.create_ordered("Run")

Names = Annotated[tuple[str, ...], SEVERAL]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]
Natural = Annotated[int, Parameter(validator=validators.Number(gte=0))]
Positive = Annotated[int, Parameter(validator=validators.Number(gte=1))]
Folders = Annotated[Path, Parameter(group=SCENES)]
Output = Annotated[Path, Parameter(alias="-o")]
RecordsFile = Annotated[Path, Parameter(alias="-o", group=RUN)]
