"""The commands of `ttempc`, one a room: `add` declares it, its function carries it out."""
