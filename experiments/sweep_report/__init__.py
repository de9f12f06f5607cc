"""What the rows of a sweep say: read, grouped, told as a page with pictures."""
