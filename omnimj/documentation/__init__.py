"""The documentation as a site: pages of `omnimj/docs`, executed tutorials, and reference made from the code."""
