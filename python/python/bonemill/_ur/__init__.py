"""The processes in which ``ur_rtde`` runs."""
