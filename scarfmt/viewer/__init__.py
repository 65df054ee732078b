"""A web server for one purpose: the viewer page and the scenes it shows, on this machine (`scarfmt view`)."""
