"""The shape of an index network: its widths and the bits of its integers (SPEC §10.5; encoder side)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NetworkShape:
    """The shape of an index network.

    Attributes:
        hidden: H, width of embedding, GRU state and attention.
        middle: width between the two layers of the embedding.
        mixer: Y, width before the heads.
        codeword_dims: R, latent dimensions of a codeword that the network sees.
        gru_layers: G.
        attention: whether states are weighed by the embedding; else the last one is taken.
        activation_bits: 8..12.
        weight_bits: about how many bits a weight takes: fixes the step of weights.
        weight_limit: largest magnitude of a weight.
        magnitude: whether a codeword's length is seen beside its dimensions: what tells the many that stand for
            "next to nothing" from the rest, which no product with the codeword itself can.
        recurrent: whether the state follows the indices sent; else it tells the stage alone, and the network is a
            perceptron over its context.
    """

    hidden: int = 16
    middle: int = 16
    mixer: int = 16
    codeword_dims: int = 12
    gru_layers: int = 1
    attention: bool = False
    activation_bits: int = 9
    weight_bits: int = 6
    weight_limit: int = 127
    magnitude: bool = True
    recurrent: bool = True

    @property
    def top(self) -> int:
        """Largest magnitude of an activation."""
        return (1 << (self.activation_bits - 1)) - 1
