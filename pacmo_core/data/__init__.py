"""What a motion is: skeletons, two-person clips, transforms, contacts, quality, splits."""
