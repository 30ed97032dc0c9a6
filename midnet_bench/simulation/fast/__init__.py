"""The world in compiled loops of our own: planar bodies without wheels, and rays against outlines."""
