"""The live page and the HTTP API of `3ds serve` (extra `serve`)."""
