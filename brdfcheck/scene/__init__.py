"""Scenes: lights, materials and shapes as pure functions over arrays of pixels, float32 by default."""
