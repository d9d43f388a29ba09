"""The documentation as a site: pages of `omnimj/docs`, executed tutorials, reference made from code."""
