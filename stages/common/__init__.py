"""What all stages share: parameters, files, clips, progress."""
