"""Gradient estimators for vector quantisation: what backpropagation sees in place of the nearest codeword.

Forward, every estimator returns the quantised vector q. Backward, each is a different linear map of the
encoder output e. Training only: neither leaves a trace in a file.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

# Below this length a direction is rounding noise.
_SHORTEST = 1e-12


def straight_through(e: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """q, with the identity as its Jacobian with respect to e.

    Args:
        e: (n, d) encoder output.
        q: (n, d) its quantised value.
    """
    return e + (q - e).detach()


def rotation_trick(e: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """q, as |q| / |e| * R e with the ratio and the rotation R, which turns e towards q, constant in backpropagation.

    Fifty et al., "Restructuring Vector Quantization with the Rotation Trick" (ICLR 2025); paper §3.3. The
    angle between the gradient at q and q itself is the angle between the gradient at e and e. R is a
    product of two reflections, R = I - 2 r r^T + 2 q^ e^T with r the direction halfway between the unit
    vectors e^ and q^; where they are opposite there is no such direction and R is one reflection.
    Rows where e or q is zero have no rotation and go straight through.

    Args:
        e: (n, d) encoder output.
        q: (n, d) its quantised value.
    """
    with torch.no_grad():
        e_length, q_length = e.norm(dim=1, keepdim=True), q.norm(dim=1, keepdim=True)
        turns = (e_length > _SHORTEST) & (q_length > _SHORTEST)
        ratio = q_length / e_length.clamp_min(_SHORTEST)
        e_unit, q_unit = e / e_length.clamp_min(_SHORTEST), q / q_length.clamp_min(_SHORTEST)
        halfway = torch.nn.functional.normalize(e_unit + q_unit, dim=1, eps=1e-6)
    reflected = e - 2 * halfway * (halfway * e).sum(1, keepdim=True)
    turned = ratio * (reflected + 2 * q_unit * (e_unit * e).sum(1, keepdim=True))
    estimate = torch.where(turns, turned, e)
    # Equal to q up to rounding already; the correction makes it exact and has no gradient.
    return estimate + (q - estimate).detach()


ESTIMATORS: dict[str, Callable[[torch.Tensor, torch.Tensor], torch.Tensor]] = {
    "rotation": rotation_trick,
    "straight-through": straight_through,
}
