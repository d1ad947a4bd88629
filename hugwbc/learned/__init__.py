"""The learned controller: the HugWBC policy (Xue et al., RSS 2025), its training in MuJoCo, and shipped policies."""
