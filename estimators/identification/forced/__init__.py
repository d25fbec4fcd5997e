"""Constants under the forces of the recording: who was poked and when, the filter that knows it, its score, centred."""
