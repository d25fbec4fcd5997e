"""Study of how often the advice GO is wrong if the true tissue or its marks differ from the scene file."""
