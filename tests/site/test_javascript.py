"""The page of the JavaScript interface: declarations with their comments, from wherever they are exported."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.site.javascript import declarations, exported

SHAPES = """/** About the file. */
/** A shape. */
export interface Shape {
    /** Metres. */
    width: number;
}
export declare class Round implements Shape {
    #private;
    private hidden;
    readonly width: number;
    /** Makes it larger. */
    grow(by: number): void;
}
/**
 * Says whether
 * it is round.
 */
export declare function isRound(shape: Shape): shape is Round;
export type Kind = "round" | "square";
"""


def test_declarations_keep_their_comments_and_lose_what_is_private() -> None:
    found = declarations(SHAPES)
    assert list(found) == ["Shape", "Round", "isRound", "Kind"]
    assert found["Shape"][0] == "A shape."
    assert found["Shape"][1] == "interface Shape {\n    /** Metres. */\n    width: number;\n}"
    assert found["Kind"][1] == 'type Kind = "round" | "square";'
    assert found["isRound"] == ("Says whether\nit is round.", "function isRound(shape: Shape): shape is Round;")
    assert found["Round"][1].startswith("class Round")
    assert "hidden" not in found["Round"][1]
    assert "#private" not in found["Round"][1]
    assert found["Round"][1].endswith("grow(by: number): void;\n}")


def test_exports_are_followed_to_where_they_are_declared(tmp_path: Path) -> None:
    (tmp_path / "shapes.d.ts").write_text(SHAPES)
    index = tmp_path / "index.d.ts"
    index.write_text('export { Round, isRound as round } from "./shapes.js";\nexport declare const x: 1;\n')
    with pytest.raises(KeyError):
        exported(index)
    index.write_text('export { Round } from "./shapes.js";\nexport declare const x: 1;\n')
    assert set(exported(index)) == {"Round", "x"}
    index.write_text('export type * from "./shapes.js";\n')
    assert set(exported(index)) == set(declarations(SHAPES))
