"""What the studies measure and draw with."""
