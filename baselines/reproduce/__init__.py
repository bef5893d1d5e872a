"""The paper's figures and claims, simulated again.

M. Boldrer, L. Lyons, L. Palopoli, D. Fontanelli, L. Ferranti, "Time-inverted Kuramoto Model Meets Lissajous Curves:
Multi-Robot Persistent Monitoring and Target Detection". `docs/paper.md` lists the conditions under which its claims are
wrong.
"""
