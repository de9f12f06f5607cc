"""The true vehicle: its file, its checks and its MuJoCo model."""
