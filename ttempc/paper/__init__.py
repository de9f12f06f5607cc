"""Controller of Kayacan, Ramon and Saeys (2016)."""
