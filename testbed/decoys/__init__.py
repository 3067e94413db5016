"""Decoys: laws that no machine has, offered to a diagnosis beside the real ones. Where one is named, trust no name."""
