"""From command to servo set point."""
