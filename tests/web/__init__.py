"""The browser package, web/: its own tests run in Node, and what it decodes is compared with the reference."""
