"""The order in which a client fetches tiles and layers: boxes, views, gains and the plan made of them.

`web/src/plan` decides the same, number for number: all arithmetic is in binary64, with + - * / and square roots alone,
in the order written. Fixtures that both are tested on lie in `tests/streaming`.
"""
