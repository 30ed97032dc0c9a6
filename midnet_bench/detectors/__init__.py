"""What MIDNet is compared with: other detectors and fusions, at the extension points that are also yours."""
