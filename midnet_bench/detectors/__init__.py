"""What MIDNet is compared with: other detectors and fusions, behind the seams where yours go in."""
