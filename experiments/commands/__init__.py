"""Commands of `ttempc`: each is a function declared with its options, see `options.command`."""
