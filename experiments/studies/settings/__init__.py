"""What each setting is worth: figures by family, at half and at twice of every choice, and the page that they make."""
