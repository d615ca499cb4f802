//! `bonemill stock`: the blocks that prostheses are milled from.

use bonemill_prosthesis::catalogue::{Catalogue, StockBlock};

use crate::args::{StockArgs, StockCommand};
use crate::outcome::Outcome;

pub fn run(args: &StockArgs) -> anyhow::Result<Outcome> {
    let path = &args.catalogue;
    let blocks = match &args.command {
        StockCommand::Add { id, size_mm, count } => {
            let stock = Catalogue::open_or_create(path)?;
            let [a, b, c] = size_mm.as_slice() else { anyhow::bail!("--size-mm needs three sides") };
            stock.add(id, [*a, *b, *c], *count)?;
            stock.list()?
        }
        StockCommand::Remove { id } => {
            Catalogue::open(path)?.remove(id)?;
            Catalogue::open(path)?.list()?
        }
        StockCommand::List => Catalogue::open(path)?.list()?,
        StockCommand::Take { id } => vec![Catalogue::open(path)?.take(id)?],
        StockCommand::Return { id } => vec![Catalogue::open(path)?.put_back(id)?],
    };
    Ok(Outcome::values("stock", blocks.iter().map(line).collect(), blocks.iter().map(object).collect()))
}

fn line(block: &StockBlock) -> String {
    let [a, b, c] = block.size_mm;
    format!("{}: {a} × {b} × {c} mm, {} left\n", block.id, block.count)
}

fn object(block: &StockBlock) -> serde_json::Value {
    serde_json::json!({ "id": block.id, "size_mm": block.size_mm, "count": block.count })
}
