"""The reference decoder's answers in the decoder protocol (conformance/PROTOCOL.md)."""
