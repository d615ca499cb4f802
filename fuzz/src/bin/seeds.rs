//! Writes every target's valid inputs to `corpus/TARGET/`, where cargo-fuzz expects them.

fn main() -> std::io::Result<()> {
    for (target, _) in bonemill_fuzz::TARGETS {
        let dir = std::path::Path::new("corpus").join(target);
        std::fs::create_dir_all(&dir)?;
        for (n, seed) in bonemill_fuzz::seeds(target).iter().enumerate() {
            std::fs::write(dir.join(format!("seed-{n}")), seed)?;
        }
    }
    Ok(())
}
