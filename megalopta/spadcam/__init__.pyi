from .recording import Recording, RecordingSettings, open_recording

__all__ = [
    "Recording",
    "RecordingSettings",
    "open_recording",
]
