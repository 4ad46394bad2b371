"""What evaluation curves say: their bands, whether anything was learned, and how soon."""
