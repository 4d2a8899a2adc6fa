"""Effects: each is whole in one declaration, with its compiled law, its slot, its starts and its sentence."""
