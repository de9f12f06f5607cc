"""Means of pictures of any run: colours, boxes of text, meshes, off-screen rendering."""
