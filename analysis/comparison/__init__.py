"""Where a model fails: errors and tests record by record, parameters test by test, and the pictures of it."""
