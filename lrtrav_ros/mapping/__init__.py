"""Maps in metres: what was found in the image, on the ground and in space."""
