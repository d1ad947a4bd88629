"""Policies of other projects as controllers: a network file, and a contract that describes it."""

from hugwbc.runtime.foreign.contract import PolicyContract, Term
from hugwbc.runtime.foreign.contract_file import CONTRACT_NAMES, load_contract
from hugwbc.runtime.foreign.foreign_policy import ForeignPolicy, load_foreign_policy

__all__ = ["CONTRACT_NAMES", "ForeignPolicy", "PolicyContract", "Term", "load_contract", "load_foreign_policy"]
