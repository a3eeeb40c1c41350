"""What a new controller or device is held against: from a passive foot to what was tuned and trained."""
