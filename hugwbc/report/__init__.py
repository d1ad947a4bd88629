"""Reports: figures with their uncertainty and the paper's, conclusions computed from them, pages and exports."""
