"""Effect files of somebody's own: tried before they are trusted, and written from a formula."""
