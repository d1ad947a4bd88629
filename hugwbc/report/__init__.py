"""What a report says: figures with their uncertainty beside the paper's, conclusions computed from them, exports."""
