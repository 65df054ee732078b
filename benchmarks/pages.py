"""The list of pages with figures: each section of a page and the results it shows. A page dates its figures."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from benchmarks import mechanisms_tables as mechanisms
from benchmarks.ablation_tables import STUDIES
from benchmarks.provenance import Document, statement
from benchmarks.quality_report import HEADLINE_NAMES
from benchmarks.report import RESULTS
from benchmarks.scenes import REPOSITORY
from benchmarks.time_error import SECTIONS

CAMPAIGNS = REPOSITORY / "fuzz" / "results"


@dataclass(frozen=True)
class Shown:
    """A section of a page, between the markers ``<!-- SECTION:begin -->`` and ``<!-- SECTION:end -->``.

    Attributes:
        page: path in the repository.
        section: name in the markers.
        results: file of results.
        part: beginning of the names shown; empty for all.
        ending: end of the names shown; empty for all.
    """

    page: str
    section: str
    results: Path
    part: str = ""
    ending: str = ""

    def text(self) -> str:
        """The text between the markers."""
        content = (REPOSITORY / self.page).read_text(encoding="utf-8")
        return content.split(f"<!-- {self.section}:begin -->")[1].split(f"<!-- {self.section}:end -->")[0]

    def dated(self) -> bool:
        """Whether the section says of its figures what the file of results says: when, which commit, which machine."""
        document: Document = json.loads(self.results.read_text(encoding="utf-8"))
        return statement(document, self.part, self.ending) in self.text()


def _of(name: str, page: str, *sections: str, parts: bool = False) -> list[Shown]:
    path = RESULTS / f"{name}.json"
    return [Shown(page, section, path, f"{section}/" if parts else "") for section in sections or (name,)]


_TRAINED = tuple(one for name in ("trained", "trained-ablations", "poses") for one in _of(name, "docs/trained.md"))
_INTERCHANGE = _of("interchange", "docs/formats-in-and-out.md")
_PORTABILITY = _of("portability", "docs/stability.md")
_STREAMING = (*_of("streaming", "docs/streaming.md"), *_of("streaming-browser", "docs/viewing.md"))
_DETAIL = _of("detail", "docs/scene-index.md")
_OVER_TIME = _of("streaming-time", "docs/streaming.md", "streaming-rivals", "streaming-times", "streaming-policies")
_PICTURES = _of("time-to-picture", "docs/time-to-picture.md", "picture-crossings", "picture-times", "picture-start-up")
SHOWN: tuple[Shown, ...] = (
    Shown("README.md", "results", RESULTS / "quality.json", ending=HEADLINE_NAMES),
    *_of("rivals", "README.md", "results"),
    *_of("quality", "docs/benchmarks.md"),
    *_of("positions", "docs/benchmarks.md"),
    *_of("gain", "docs/benchmarks.md"),
    *_of("rivals", "docs/rivals.md", "rivals-verdicts", "rivals-scenes"),
    *_of("rivals", "docs/compare.md", "compare-formats"),
    *_of("scaling", "docs/scaling.md"),
    *_of("survey-time", "docs/scaling.md"),
    *_of("training-step", "docs/training.md"),
    *_of("regions", "docs/scaling.md"),
    *_of("directory", "docs/scaling.md"),
    *_of("large-scene", "docs/large-scenes.md"),
    *_of("scale-loss", "docs/large-scenes.md"),
    *_of("stability", "docs/stability.md"),
    *_of("entropy-speed", "docs/entropy-speed.md"),
    *_of("entropy-stress", "docs/entropy-stress.md"),
    *_of("example", "examples/README.md"),
    *_of("ablation", "docs/ablations.md", *STUDIES, parts=True),
    *_of("mechanisms", "docs/mechanisms.md", *mechanisms.STUDIES, parts=True),
    *_of("time-error", "docs/time-and-error.md", *SECTIONS, parts=True),
    # Nothing is shown until it was measured.
    *(
        shown
        for shown in (*_INTERCHANGE, *_PORTABILITY, *_STREAMING, *_DETAIL, *_OVER_TIME, *_PICTURES, *_TRAINED)
        if shown.results.exists()
    ),
    *(Shown("docs/fuzzing.md", "campaigns", path) for path in sorted(CAMPAIGNS.glob("*.json"))),
)
"""Every section that a benchmark or a campaign writes."""
